"""Endings of one and of all, joining and leaving, and long delays (held back)."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Rovers(Turns):
    """Three rovers and two landers act in turn; a rover stops for good when its cells are empty.

    Rovers drive 0 to 2 fields and use 1 + that of 5 to 11 units (a truncation of their own). The
    landers, last in each round, see their fields of this round and photograph (1) or don't: a
    photograph pays its lander those fields. The mission lasts 26 rounds.
    """

    def __init__(self) -> None:
        agents = [*names("rover", 3), *names("lander", 2)]
        super().__init__(agents, box(1, -5, 20), {"rover": Discrete(3), "lander": Discrete(2)}, 26)

    def _start(self, rng: Any) -> None:
        self.cells, self.fields = {a: int(rng.integers(5, 12)) for a in names("rover", 3)}, 0

    def _act(self, agent: str, action: Any) -> None:
        if agent.startswith("lander"):
            self._pay(agent, self.fields if action else 0.0)
            return
        self.cells[agent] -= 1 + int(action)
        self.fields += int(action)
        self._pay(agent, 0.1 * int(action))
        if self.cells[agent] <= 0:
            self._cut(agent)

    def _close(self) -> None:
        self.fields = 0

    def _look(self, agent: str) -> Any:
        return vector(self.fields if agent.startswith("lander") else self.cells[agent])


ROVERS = Form(
    name="rovers",
    api="aec",
    stages=(("rover",), ("lander",)),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={
        "drive": Part("rover", "earner", "individual"),
        "photograph": Part("all", "lander", "individual"),
    },
    endings={"cells": Ending("truncation", "agent"), "time": TIME},
    symmetric={"rover": True, "lander": True},
    horizon=26,
    influence=links("rover lander observation 0", "rover lander reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)


class Cave(Ticks):
    """Three cavers dig (1 or 4) or walk out (0) at once; the roof falls on all that are still in.

    Digging wears the roof by its strength times a drawn factor; at 14 it falls: -4 for each caver
    inside, the end of all. One that walks out is paid what it has dug and has ended for itself.
    """

    def __init__(self) -> None:
        super().__init__(names("caver", 3), box(2, 0, 60), Discrete(10), 12)

    def _start(self, rng: Any) -> None:
        self.wear, self.dug = float(rng.uniform(0, 2)), dict.fromkeys(self.agents, 0)

    def _tick(self, actions: Any) -> None:
        out = [agent for agent in self.agents if int(actions[agent]) == 0]
        dig = {a: 1 + 3 * (int(actions[a]) % 2) for a in self.agents if a not in out}
        for agent in out:
            self._pay(agent, self.dug[agent])
            self._end(agent)
        for agent, strength in dig.items():
            self.dug[agent] += strength
        self.wear += sum(dig.values()) * float(self.rng.uniform(0, 0.35))
        if self.wear >= 14:
            for agent in dig:
                self._pay(agent, -4.0)
            self._end(*self.agents)

    def _look(self, agent: str) -> Any:
        return vector(self.wear, self.dug[agent])


CAVE = Form(
    name="cave",
    api="parallel",
    stages=(("caver",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "gold": Part("caver", "earner", "individual", None),
        "fall": Part("caver", "all", "shared"),
    },
    endings={
        "out": Ending("termination", "agent"),
        "fall": Ending("termination", "all"),
        "time": TIME,
    },
    symmetric={"caver": True},
    horizon=12,
    influence=links("caver caver observation 1", "caver caver reward 0", "caver caver ending 0"),
    order_sensitive="none",
    advice="parallel",
    doubtful=("rewards",),
)


class Bus(Ticks):
    """A driver and passengers that board at ticks 2, 6 and 13; each rides 4 stops and gets off.

    The driver sets the speed 0 to 2; each passenger on board tips (0 to 2) the driver and is paid
    the speed minus its tip. Getting off is a termination of its own; the driver drives 16 ticks.
    """

    def __init__(self) -> None:
        agents = ["driver_0", *names("passenger", 3)]
        super().__init__(agents, box(2, -1, 9), Discrete(3), 16)

    def _first(self) -> list[str]:
        return ["driver_0"]

    def _start(self, rng: Any) -> None:
        self.speed, self.ridden = -1, dict.fromkeys(self.possible_agents, 0)

    def _tick(self, actions: Any) -> None:
        self.speed = int(actions["driver_0"])
        for agent in self.agents[1:]:
            self._pay(agent, self.speed - int(actions[agent]))
            self._pay("driver_0", int(actions[agent]))
            self.ridden[agent] += 1
            if self.ridden[agent] == 4:
                self._end(agent)
        if self.t in (2, 6, 13):
            self._join(f"passenger_{(2, 6, 13).index(self.t)}")

    def _look(self, agent: str) -> Any:
        return vector(self.speed, self.ridden[agent])


BUS = Form(
    name="bus",
    api="parallel",
    stages=(("driver", "passenger"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "ride": Part("all", "passenger", "individual"),
        "tip": Part("passenger", "driver", "individual"),
    },
    endings={"off": Ending("termination", "agent"), "time": TIME},
    may_join=("passenger",),
    symmetric={"driver": None, "passenger": None},
    horizon=16,
    influence=links(
        "driver passenger observation 1", "driver passenger reward 0", "passenger driver reward 0"
    ),
    order_sensitive="none",
    advice="parallel",
)


class Fair(Ticks):
    """Stalls at a fair: two from the start, one that comes at tick 3; the second leaves at tick 8.

    It goes out of `agents` with neither flag up, whatever is done, so PettingZoo's
    `parallel_api_test` fails by design. Stalls set a price 1 to 4; the cheapest ones sell to all.
    """

    def __init__(self) -> None:
        super().__init__(names("stall", 3), box(1, 0, 9), Discrete(4), 17)

    def _first(self) -> list[str]:
        return names("stall", 2)

    def _start(self, rng: Any) -> None:
        self.crowd = int(rng.integers(1, 9))

    def _tick(self, actions: Any) -> None:
        price = {agent: 1 + int(actions[agent]) for agent in self.agents}
        low = [agent for agent in self.agents if price[agent] == min(price.values())]
        for agent in low:
            self._pay(agent, price[agent] * self.crowd / len(low))
        self.crowd = int(self.rng.integers(1, 9))
        if self.t == 3:
            self._join("stall_2")

    def step(self, actions: Any) -> Any:
        """Plays one tick; at the eighth, the second stall is gone after it."""
        answer = super().step(actions)
        if self.t == 8:
            self.agents = [agent for agent in self.agents if agent != "stall_1"]
        return answer

    def _look(self, agent: str) -> Any:
        return vector(self.crowd)


FAIR = Form(
    name="fair",
    api="parallel",
    stages=(("stall",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"sale": Part("stall", "earner", "individual")},
    endings={"time": TIME},
    may_join=("stall",),
    may_leave=("stall",),
    symmetric={"stall": None},
    horizon=17,
    influence=links("stall stall reward 0"),
    order_sensitive="none",
    advice="parallel",
)


class Vineyard(Ticks):
    """Three vintners press 0 to 3 barrels; a barrel is wine after six ticks and sold for all.

    The price of a barrel is drawn when it is sold; a third of the sale is paid to each. What was
    pressed is seen by nobody, the number of barrels sold in the last tick by all.
    """

    def __init__(self) -> None:
        super().__init__(names("vintner", 3), box(1, 0, 12), Discrete(4), 29)

    def _start(self, rng: Any) -> None:
        self.cellar, self.sold = [0] * 6, 0

    def _tick(self, actions: Any) -> None:
        self.cellar.append(sum(int(actions[agent]) for agent in self.agents))
        self.sold = self.cellar.pop(0)
        price = int(self.rng.integers(1, 6))
        for agent in self.agents:
            self._pay(agent, self.sold * price / 3)

    def _look(self, agent: str) -> Any:
        return vector(self.sold)


VINEYARD = Form(
    name="vineyard",
    api="parallel",
    stages=(("vintner",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"wine": Part("vintner", "all", "shared", 6)},
    endings={"time": TIME},
    symmetric={"vintner": True},
    horizon=29,
    influence=links("vintner vintner reward 6", "vintner vintner observation 7"),
    order_sensitive="none",
    advice="parallel",
    doubtful=("advice",),
)


class Echo(Turns):
    """Two bats cry (-1 to 1) one after the other; each hears the other's cry of four rounds ago.

    Cries take effect together at the end of the round: each is paid its own and minus a half of the
    other's square of three rounds ago.
    """

    def __init__(self) -> None:
        super().__init__(names("bat", 2), box(1, -2, 2), Box(-1, 1, (1,), np.float32), 25)

    def _start(self, rng: Any) -> None:
        self.cries = {agent: [0.0] * 4 for agent in self.possible_agents}
        self.now: dict[str, float] = {}
        self.gain = float(rng.uniform(1, 2))

    def _act(self, agent: str, action: Any) -> None:
        self.now[agent] = float(np.clip(action[0], -1, 1))

    def _close(self) -> None:
        for agent, cry in self.now.items():
            self.cries[agent] = [*self.cries[agent][1:], cry]
        for agent, other in (("bat_0", "bat_1"), ("bat_1", "bat_0")):
            self._pay(agent, self.gain * self.now[agent] - self.cries[other][0] ** 2 / 2)
        self.now = {}

    def _look(self, agent: str) -> Any:
        return vector(self.cries["bat_1" if agent == "bat_0" else "bat_0"][0])


ECHO = Form(
    name="echo",
    api="aec",
    stages=(("bat",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "cry": Part("bat", "earner", "individual"),
        "noise": Part("bat", "bat", "individual", 3),
    },
    endings={"time": TIME},
    symmetric={"bat": True},
    horizon=25,
    influence=links("bat bat observation 4", "bat bat reward 3"),
    order_sensitive=None,
    advice="parallel",
    doubtful=("advice",),
)

FORMS = (
    (Rovers, ROVERS),
    (Cave, CAVE),
    (Bus, BUS),
    (Fair, FAIR),
    (Vineyard, VINEYARD),
    (Echo, ECHO),
)
