"""Races for one place: the order of handling decides, is drawn, or has no effect."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Form, Part, links

RACE = {
    "rewards": {"berth": Part("boat", "earner", "individual")},
    "endings": {"time": TIME},
    "horizon": 18,
    "observe": "after tick",
}


class BerthFixed(Turns):
    """Three boats ask for one of two berths of drawn fees, always in the order of their names.

    The first that asks has the berth. Boats see today's fees and nothing of each other.
    """

    def __init__(self) -> None:
        super().__init__(names("boat", 3), box(2, 0, 10), Discrete(3), 18)

    def _start(self, rng: Any) -> None:
        self.fees, self.taken = rng.integers(1, 10, 2), set()

    def _act(self, agent: str, action: Any) -> None:
        berth = int(action)
        if berth < 2 and berth not in self.taken:
            self.taken.add(berth)
            self._pay(agent, self.fees[berth])

    def _close(self) -> None:
        self.fees, self.taken = self.rng.integers(1, 10, 2), set()

    def _look(self, agent: str) -> Any:
        return vector(*self.fees)


BERTH_FIXED = Form(
    name="berth_fixed",
    api="aec",
    stages=(("boat",),),
    order="fixed",
    conflicts="ordered",
    symmetric={"boat": False},
    influence=links("boat boat reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("reward",),
    **RACE,
)


class BerthRotating(BerthFixed):
    """The boat that asked first today asks last tomorrow."""

    def _order(self) -> list[str]:
        live, first = self._live(), self.t % 3
        return live[first:] + live[:first]


BERTH_ROTATING = Form(
    name="berth_rotating",
    api="aec",
    stages=(("boat",),),
    order="rotating",
    conflicts="ordered",
    symmetric={"boat": None},
    influence=links("boat boat reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("reward",),
    **RACE,
)


class BerthDrawn(BerthFixed):
    """Boats ask in an order that is drawn anew each day."""

    def _order(self) -> list[str]:
        live = self._live()
        return [live[i] for i in self.rng.permutation(len(live))]


BERTH_DRAWN = Form(
    name="berth_drawn",
    api="aec",
    stages=(("boat",),),
    order="random",
    conflicts="ordered",
    symmetric={"boat": True},
    influence=links("boat boat reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("reward",),
    doubtful=("conflicts", "advice"),
    **RACE,
)


class BerthSealed(BerthDrawn):
    """Requests lie in a box, in drawn order; at night, those for one berth share its fee."""

    def _act(self, agent: str, action: Any) -> None:
        self.box[agent] = int(action)

    def _close(self) -> None:
        for berth in (0, 1):
            same = [agent for agent, chosen in self.box.items() if chosen == berth]
            for agent in same:
                self._pay(agent, self.fees[berth] / len(same))
        self.box, self.fees = {}, self.rng.integers(1, 10, 2)

    def _start(self, rng: Any) -> None:
        super()._start(rng)
        self.box = {}


BERTH_SEALED = Form(
    name="berth_sealed",
    api="aec",
    stages=(("boat",),),
    order="none",
    conflicts="joint rule",
    symmetric={"boat": True},
    influence=links("boat boat reward 0"),
    order_sensitive=None,
    advice="parallel",
    doubtful=("order",),
    **RACE,
)


class Mooring(Ticks):
    """Three ferries name one of two buoys of drawn depth at once; one ferry a buoy is paid."""

    def __init__(self) -> None:
        super().__init__(names("ferry", 3), box(2, 0, 10), Discrete(3), 25)

    def _start(self, rng: Any) -> None:
        self.depths = rng.integers(1, 10, 2)

    def _ranked(self, actions: Any) -> list[str]:
        raise NotImplementedError

    def _tick(self, actions: Any) -> None:
        taken = set()
        for agent in self._ranked(actions):
            buoy = int(actions[agent])
            if buoy < 2 and buoy not in taken:
                taken.add(buoy)
                self._pay(agent, self.depths[buoy])
        self.depths = self.rng.integers(1, 10, 2)

    def _look(self, agent: str) -> Any:
        return vector(*self.depths)


MOORING = {
    "api": "parallel",
    "stages": (("ferry",),),
    "order": "none",
    "observe": "after tick",
    "rewards": {"buoy": Part("ferry", "earner", "individual")},
    "endings": {"time": TIME},
    "horizon": 25,
    "influence": links("ferry ferry reward 0"),
}


class MooringRoster(Mooring):
    """The ferry that stands first in `agents` has the buoy, whatever the dictionary's order."""

    def _ranked(self, actions: Any) -> list[str]:
        return list(self.agents)


MOORING_ROSTER = Form(
    name="mooring_roster",
    conflicts="priority",
    priority="roster",
    symmetric={"ferry": False},
    order_sensitive="none",
    advice="aec",
    because=("reward",),
    doubtful=("order", "advice", "order_sensitive"),
    **MOORING,
)


class MooringDictionary(Mooring):
    """The ferry that the caller names first has the buoy."""

    def _ranked(self, actions: Any) -> list[str]:
        return list(actions)


MOORING_DICTIONARY = Form(
    name="mooring_dictionary",
    conflicts="priority",
    priority="dictionary",
    symmetric={"ferry": None},
    order_sensitive="outcome",
    advice=None,
    doubtful=("order",),
    **MOORING,
)


class MooringLot(Mooring):
    """A lot that is drawn each tick, whatever the ferries do, says which has the buoy."""

    def _ranked(self, actions: Any) -> list[str]:
        return [self.agents[i] for i in self.rng.permutation(len(self.agents))]


MOORING_LOT = Form(
    name="mooring_lot",
    conflicts="random",
    symmetric={"ferry": True},
    order_sensitive="none",
    advice="parallel",
    **MOORING,
)


class Kites(Ticks):
    """Four kites take 0 to 2 m of line; the gust of each is drawn in the order of the dictionary.

    The gusts are of one kind, so another order gives other draws and the same game.
    """

    def __init__(self) -> None:
        super().__init__(names("kite", 4), box(1, -60, 60), Discrete(3), 16)

    def _start(self, rng: Any) -> None:
        self.height = dict.fromkeys(self.possible_agents, 0.0)

    def _tick(self, actions: Any) -> None:
        for agent, action in actions.items():
            self.height[agent] += int(action) * self.rng.normal() + 1.0
            self._pay(agent, self.height[agent] > 0)

    def _look(self, agent: str) -> Any:
        return vector(clipped(self.height[agent]))


def clipped(height: float) -> float:
    """A height inside the observation space."""
    return max(-60.0, min(60.0, height))


KITES = Form(
    name="kites",
    api="parallel",
    stages=(("kite",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"aloft": Part("kite", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"kite": True},
    horizon=16,
    influence=links(),
    order_sensitive="draws",
    advice="either",
)

FORMS = (
    (BerthFixed, BERTH_FIXED),
    (BerthRotating, BERTH_ROTATING),
    (BerthDrawn, BERTH_DRAWN),
    (BerthSealed, BERTH_SEALED),
    (MooringRoster, MOORING_ROSTER),
    (MooringDictionary, MOORING_DICTIONARY),
    (MooringLot, MOORING_LOT),
    (Kites, KITES),
)
