"""Endings of one agent and of all, None steps of ended agents, joining and leaving."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Survey(Ticks):
    """Three drones map fields until their own battery is empty; two bases stay for 40 ticks.

    A drone flies at speed 0 to 2 and uses 1 + speed of 6 to 12 units; its speed is added to the
    map, which pays all. A base may send a report (0.1 for itself); it sees the size of the map.
    """

    def __init__(self) -> None:
        agents = [*names("base", 2), *names("drone", 3)]
        super().__init__(agents, box(1, -5, 200), {"base": Discrete(2), "drone": Discrete(3)}, 40)

    def _start(self, rng: Any) -> None:
        self.map = 0
        self.battery = {a: int(rng.integers(6, 13)) for a in names("drone", 3)}

    def _tick(self, actions: Any) -> None:
        flown = {a: int(actions[a]) for a in self.agents if a.startswith("drone")}
        for agent, speed in flown.items():
            self.battery[agent] -= 1 + speed
            if self.battery[agent] <= 0:
                self._cut(agent)
        self.map += sum(flown.values())
        for agent in self.agents:
            self._pay(agent, sum(flown.values()))
            if agent not in flown:
                self._pay(agent, 0.1 * int(actions[agent]))

    def _look(self, agent: str) -> Any:
        return vector(self.battery.get(agent, self.map))


SURVEY = Form(
    name="survey",
    api="parallel",
    stages=(("base", "drone"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"map": Part("drone", "all", "shared"), "report": Part("base", "earner", "individual")},
    endings={"battery": Ending("truncation", "agent"), "time": TIME},
    symmetric={"base": True, "drone": True},
    horizon=40,
    influence=links("drone base reward 0", "drone base observation 1", "drone drone reward 0"),
    order_sensitive="none",
    advice="parallel",
)


class LastOut(Turns):
    """Four players put 1 or 2 into the pot, or fold (0) and are out, with a quarter of the pot.

    All see pot and players. The last player left has the pot and is out; 14 rounds end it.
    """

    def __init__(self) -> None:
        super().__init__(names("player", 4), box(2, 0, 200), Discrete(13), 14)

    def _start(self, rng: Any) -> None:
        self.pot = int(rng.integers(2, 9))

    def _act(self, agent: str, action: Any) -> None:
        if action:
            stake = 1 + int(action) % 2
            self.pot += stake
            self._pay(agent, -stake)
            return
        self._pay(agent, self.pot / 4)
        self.pot -= self.pot // 4
        self._end(agent)
        if len(self._live()) == 1:
            self._pay(self._live()[0], self.pot)
            self._end(*self._live())

    def _look(self, agent: str) -> Any:
        return vector(self.pot, len(self._live()))


LAST_OUT = Form(
    name="last_out",
    api="aec",
    stages=(("player",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={
        "pot": Part("player", "earner", "individual"),
        "stake": Part("player", "earner", "individual"),
    },
    endings={
        "fold": Ending("termination", "agent"),
        "last": Ending("termination", "agent"),
        "time": TIME,
    },
    symmetric={"player": False},
    horizon=14,
    influence=links(
        "player player observation 0", "player player reward 0", "player player ending 0"
    ),
    order_sensitive=None,
    advice="aec",
    because=("state", "reward"),
)


class Rope(Ticks):
    """Two climbers on the rope of a belayer, all at once.

    A climber climbs (1) or rests (0). Where both climb and the belayer rests, the rope slips; at
    the second slip all fall: -5 for all, the end. At height 7 a climber is up: paid 3, and it ends.
    """

    def __init__(self) -> None:
        agents = [*names("climber", 2), "belayer_0"]
        super().__init__(agents, box(2, 0, 20), Discrete(2), 32)

    def _start(self, rng: Any) -> None:
        self.height = {a: int(rng.integers(0, 4)) for a in names("climber", 2)}
        self.slips = 0

    def _tick(self, actions: Any) -> None:
        climbing = [a for a in self.agents if a != "belayer_0" and int(actions[a])]
        self.slips += len(climbing) == 2 and not int(actions["belayer_0"])
        if self.slips == 2:
            for agent in self.agents:
                self._pay(agent, -5.0)
            self._end(*self.agents)
            return
        for agent in climbing:
            self.height[agent] += 1
            if self.height[agent] == 7:
                self._pay(agent, 3.0)
                self._end(agent)

    def _look(self, agent: str) -> Any:
        return vector(self.slips, self.height.get(agent, 0))


ROPE = Form(
    name="rope",
    api="parallel",
    stages=(("climber", "belayer"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"fall": Part("all", "all", "shared"), "top": Part("climber", "earner", "individual")},
    endings={
        "fall": Ending("termination", "all"),
        "top": Ending("termination", "agent"),
        "time": TIME,
    },
    symmetric={"climber": True, "belayer": None},
    horizon=32,
    influence=links(
        *[
            f"{source} {to} {on}"
            for source, to in (
                ("climber", "climber"),
                ("climber", "belayer"),
                ("belayer", "climber"),
            )
            for on in ("observation 1", "reward 0", "ending 0")
        ]
    ),
    order_sensitive="none",
    advice="parallel",
)


class Ward(Ticks):
    """Two nurses care for patients; a third joins at tick 4, a fourth at tick 9.

    Each cares (1) or rests; patients that are waiting are shared out evenly between all that care.
    A nurse that has cared 12 times goes home: its own termination. A day has 24 ticks.
    """

    def __init__(self) -> None:
        super().__init__(names("nurse", 4), box(2, 0, 50), Discrete(2), 24)

    def _first(self) -> list[str]:
        return names("nurse", 2)

    def _start(self, rng: Any) -> None:
        self.waiting, self.done = int(rng.integers(1, 6)), dict.fromkeys(self.possible_agents, 0)

    def _tick(self, actions: Any) -> None:
        caring = [agent for agent in self.agents if int(actions[agent])]
        for agent in caring:
            self._pay(agent, self.waiting / len(caring))
            self.done[agent] += 1
            if self.done[agent] == 12:
                self._end(agent)
        self.waiting = int(self.rng.integers(1, 6)) + (0 if caring else min(self.waiting, 40))
        if self.t in (4, 9):
            self._join("nurse_2" if self.t == 4 else "nurse_3")

    def _look(self, agent: str) -> Any:
        return vector(self.waiting, self.done[agent])


WARD = Form(
    name="ward",
    api="parallel",
    stages=(("nurse",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"care": Part("nurse", "earner", "individual")},
    endings={"home": Ending("termination", "agent"), "time": TIME},
    may_join=("nurse",),
    symmetric={"nurse": None},
    horizon=24,
    influence=links("nurse nurse reward 0", "nurse nurse observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Harbor(Ticks):
    """Three tugs pull a ship (0 to 2 each); one that pulls 0 eight times in all just sails away.

    It leaves `agents` with neither flag up: PettingZoo's `parallel_api_test` fails by design. The
    ship pays all tugs that are there the strength of the second strongest pull.
    """

    def __init__(self) -> None:
        super().__init__(names("tug", 3), box(2, 0, 30), Discrete(3), 22)

    def _start(self, rng: Any) -> None:
        self.idle, self.wave = dict.fromkeys(self.possible_agents, 0), int(rng.integers(0, 9))

    def _tick(self, actions: Any) -> None:
        pulls = sorted((int(actions[agent]) for agent in self.agents), reverse=True)
        for agent in self.agents:
            self._pay(agent, pulls[1] if len(pulls) > 1 else 0.0)
            self.idle[agent] += int(actions[agent]) == 0
        self.wave = int(self.rng.integers(0, 9))

    def step(self, actions: Any) -> Any:
        """Plays one tick; tugs that have idled eight times are gone after it."""
        answer = super().step(actions)
        self.agents = [agent for agent in self.agents if self.idle[agent] < 8]
        return answer

    def _look(self, agent: str) -> Any:
        return vector(self.idle[agent], self.wave)


HARBOR = Form(
    name="harbor",
    api="parallel",
    stages=(("tug",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"pull": Part("tug", "all", "shared")},
    endings={"time": TIME},
    may_leave=("tug",),
    symmetric={"tug": True},
    horizon=22,
    influence=links("tug tug reward 0"),
    order_sensitive="none",
    advice="parallel",
)


class Queue(Turns):
    """Two guests order dishes of a common stock in turn; a third guest comes in the fourth round.

    Actions 6 and 7 order 1 and 2 dishes of what is left of the evening's stock, which pay 1 each; a
    guest that has eaten 8 is full and goes: its own termination. The empty stock ends the evening.
    """

    def __init__(self) -> None:
        super().__init__(names("guest", 3), box(2, 0, 40), Discrete(8), 16)

    def _first(self) -> list[str]:
        return names("guest", 2)

    def _start(self, rng: Any) -> None:
        self.stock, self.eaten = int(rng.integers(12, 19)), dict.fromkeys(self.possible_agents, 0)

    def _act(self, agent: str, action: Any) -> None:
        dishes = min(max(0, int(action) - 5), self.stock)
        self.stock -= dishes
        self.eaten[agent] += dishes
        self._pay(agent, dishes)
        if self.eaten[agent] >= 8:
            self._end(agent)
        if self.stock == 0:
            self._end(*self.agents)

    def _close(self) -> None:
        if self.t == 3 and self._live():
            self._join("guest_2")

    def _look(self, agent: str) -> Any:
        return vector(self.stock, self.eaten[agent])


QUEUE = Form(
    name="queue",
    api="aec",
    stages=(("guest",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"dish": Part("guest", "earner", "individual")},
    endings={
        "full": Ending("termination", "agent"),
        "sold out": Ending("termination", "all"),
        "time": TIME,
    },
    may_join=("guest",),
    symmetric={"guest": False},
    horizon=16,
    influence=links("guest guest observation 0", "guest guest reward 0", "guest guest ending 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)

FORMS = (
    (Survey, SURVEY),
    (LastOut, LAST_OUT),
    (Rope, ROPE),
    (Ward, WARD),
    (Harbor, HARBOR),
    (Queue, QUEUE),
)
