"""Moves that open and close the moves of others, in the same round or in the next one."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Box, Dict, Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class CrateLid(Turns):
    """The lifter may lift the lid; only then may the hauler pull a parcel out in the same round.

    Neither sees the lid, the mask alone tells. Each parcel pays both; the empty crate ends it.
    """

    def __init__(self) -> None:
        super().__init__(["lifter_0", "hauler_0"], box(1, 0, 20), Discrete(2), 30)

    def _start(self, rng: Any) -> None:
        self.parcels, self.open = int(rng.integers(4, 8)), False

    def _act(self, agent: str, action: Any) -> None:
        if agent == "lifter_0":
            self.open = bool(action)
        elif action and self.open:
            self.parcels -= 1
            self._pay("lifter_0", 1.0)
            self._pay("hauler_0", 1.0)
            if self.parcels == 0:
                self._end("lifter_0", "hauler_0")

    def _close(self) -> None:
        self.open = False

    def _mask(self, agent: str) -> Any:
        return [1, 1 if agent == "lifter_0" else self.open]

    def _look(self, agent: str) -> Any:
        return vector(self.parcels)


CRATE_LID = Form(
    name="crate_lid",
    api="aec",
    stages=(("lifter",), ("hauler",)),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    legality=True,
    rewards={"parcel": Part("hauler", "all", "shared")},
    endings={"empty": Ending("termination", "all"), "time": TIME},
    symmetric={"lifter": None, "hauler": None},
    horizon=30,
    influence=links(
        "lifter hauler mask 0",
        "lifter hauler reward 0",
        "lifter hauler observation 1",
        "lifter hauler ending 0",
        "hauler lifter reward 0",
        "hauler lifter observation 1",
        "hauler lifter ending 0",
    ),
    order_sensitive=None,
    advice="aec",
    because=("legality",),
)


class Turnstile(Ticks):
    """The keeper opens gate 1, gate 2 or none for the next tick; runners pass open gates.

    A pass pays the runner 1 and the keeper a toll of 0.5. Runners see their own passes alone.
    """

    def __init__(self) -> None:
        agents = ["keeper_0", *names("runner", 2)]
        super().__init__(agents, box(1, 0, 40), Discrete(3), 20)

    def _start(self, rng: Any) -> None:
        self.gate, self.passes = 0, dict.fromkeys(self.possible_agents, 0)

    def _tick(self, actions: Any) -> None:
        for agent in self.agents[1:]:
            if self.gate and int(actions[agent]) == self.gate:
                self.passes[agent] += 1
                self._pay(agent, 1.0)
                self._pay("keeper_0", 0.5)
        self.gate = int(actions["keeper_0"])

    def _mask(self, agent: str) -> Any:
        return [1, 1, 1] if agent == "keeper_0" else [1, self.gate == 1, self.gate == 2]

    def _look(self, agent: str) -> Any:
        if agent == "keeper_0":
            return vector(sum(self.passes.values()))
        return vector(self.passes[agent])


TURNSTILE = Form(
    name="turnstile",
    api="parallel",
    stages=(("keeper", "runner"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    legality=True,
    rewards={
        "pass": Part("runner", "earner", "individual"),
        "toll": Part("runner", "keeper", "individual"),
    },
    endings={"time": TIME},
    symmetric={"keeper": None, "runner": True},
    horizon=20,
    influence=links(
        "keeper runner mask 1",
        "keeper runner reward 1",
        "keeper runner observation 2",
        "runner keeper reward 0",
        "runner keeper observation 1",
    ),
    order_sensitive="none",
    advice="parallel",
)


class Draft(Turns):
    """Three managers draft one of five players of drawn worth each round; first pick rotates.

    All see the worths at the start of the round; the mask in the observation tells who is taken.
    """

    def __init__(self) -> None:
        observes = Dict({"observation": box(5, 0, 20), "action_mask": Box(0, 1, (5,), "int8")})
        super().__init__(names("manager", 3), observes, Discrete(5), 12)

    def _start(self, rng: Any) -> None:
        self.worth, self.free = rng.integers(1, 20, 5), [1] * 5

    def _order(self) -> list[str]:
        live, first = self._live(), self.t % 3
        return live[first:] + live[:first]

    def _act(self, agent: str, action: Any) -> None:
        if self.free[int(action)]:
            self.free[int(action)] = 0
            self._pay(agent, self.worth[int(action)])

    def _close(self) -> None:
        self.worth, self.free = self.rng.integers(1, 20, 5), [1] * 5

    def _look(self, agent: str) -> Any:
        mask = vector(*self.free).astype("int8")
        return {"observation": vector(*self.worth), "action_mask": mask}


DRAFT = Form(
    name="draft",
    api="aec",
    stages=(("manager",),),
    order="rotating",
    observe="after turn",
    conflicts="ordered",
    legality=True,
    rewards={"worth": Part("manager", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"manager": None},
    horizon=12,
    influence=links("manager manager mask 0", "manager manager reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("legality",),
)


class Gears(Turns):
    """Two riders of a tandem set gear 0 to 3 in turn; both gears engage after both are set.

    A rider may not take the gear that the other set last round. Equal gears pay the drawn slope.
    """

    def __init__(self) -> None:
        super().__init__(names("rider", 2), box(1, 0, 5), Discrete(4), 14)

    def _start(self, rng: Any) -> None:
        self.set, self.engaged = {}, dict.fromkeys(self.possible_agents, -1)
        self.slope = int(rng.integers(1, 5))

    def _act(self, agent: str, action: Any) -> None:
        self.set[agent] = int(action)

    def _close(self) -> None:
        self.engaged, self.set = self.set, {}
        if self.engaged["rider_0"] == self.engaged["rider_1"]:
            for agent in self._live():
                self._pay(agent, self.slope)
        self.slope = int(self.rng.integers(1, 5))

    def _mask(self, agent: str) -> Any:
        other = self.engaged["rider_1" if agent == "rider_0" else "rider_0"]
        return [gear != other for gear in range(4)]

    def _look(self, agent: str) -> Any:
        return vector(self.slope)


GEARS = Form(
    name="gears",
    api="aec",
    stages=(("rider",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    legality=True,
    rewards={"equal": Part("all", "all", "shared")},
    endings={"time": TIME},
    symmetric={"rider": True},
    horizon=14,
    influence=links("rider rider mask 1", "rider rider reward 0"),
    order_sensitive=None,
    advice="parallel",
)


class Camels(Turns):
    """Three camels race; each round the hindmost moves first, by 3 or 6 steps.

    Each stands on a remainder of its own modulo 3, drawn at the start, so no two are level. A camel
    is paid 1 for each other that it overtakes; the first at 40 ends the race and is paid 5.
    """

    def __init__(self) -> None:
        super().__init__(names("camel", 3), box(3, 0, 60), Discrete(2), None)

    def _start(self, rng: Any) -> None:
        self.at = dict(zip(self.possible_agents, rng.permutation(3).tolist(), strict=True))

    def _order(self) -> list[str]:
        return sorted(self._live(), key=self.at.__getitem__)

    def _act(self, agent: str, action: Any) -> None:
        old, new = self.at[agent], self.at[agent] + 3 + 3 * int(action)
        self.at[agent] = new
        self._pay(agent, sum(old < place < new for place in self.at.values()))
        if new >= 40:
            self._pay(agent, 5.0)
            self._end(*self._live())

    def _look(self, agent: str) -> Any:
        others = sorted(place for name, place in self.at.items() if name != agent)
        return vector(self.at[agent], *others)


CAMELS = Form(
    name="camels",
    api="aec",
    stages=(("camel",),),
    order="state",
    observe="after turn",
    conflicts="ordered",
    rewards={
        "overtake": Part("camel", "earner", "individual"),
        "finish": Part("camel", "earner", "individual"),
    },
    endings={"finish": Ending("termination", "all")},
    symmetric={"camel": True},
    horizon=None,
    influence=links("camel camel observation 0", "camel camel reward 0", "camel camel ending 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)

FORMS = (
    (CrateLid, CRATE_LID),
    (Turnstile, TURNSTILE),
    (Draft, DRAFT),
    (Gears, GEARS),
    (Camels, CAMELS),
)
