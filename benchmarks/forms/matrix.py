"""Repeated matrix games, a lone agent and agents that have nothing to do with each other."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Discrete

from benchmarks.forms.bases import Ticks, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Dilemma(Ticks):
    """Two prisoners cooperate (0) or defect (1) for twelve rounds and see the last round."""

    PAYOFF = ((3.0, 0.0), (5.0, 1.0))

    def __init__(self) -> None:
        super().__init__(names("prisoner", 2), box(2, -1, 1), Discrete(2), 12)

    def _start(self, rng: Any) -> None:
        self.last = dict.fromkeys(self.possible_agents, -1)

    def _tick(self, actions: Any) -> None:
        self.last = {agent: int(actions[agent]) for agent in self.agents}
        for agent, other in (("prisoner_0", "prisoner_1"), ("prisoner_1", "prisoner_0")):
            self._pay(agent, self.PAYOFF[self.last[agent]][self.last[other]])

    def _look(self, agent: str) -> Any:
        other = "prisoner_1" if agent == "prisoner_0" else "prisoner_0"
        return vector(self.last[agent], self.last[other])


DILEMMA = Form(
    name="dilemma",
    api="parallel",
    stages=(("prisoner",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"sentence": Part("prisoner", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"prisoner": True},
    horizon=12,
    influence=links("prisoner prisoner reward 0", "prisoner prisoner observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Pennies(Ticks):
    """Matching pennies: the matcher wins equal coins, the hider unequal ones, of drawn worth."""

    def __init__(self) -> None:
        super().__init__(["matcher", "hider"], box(3, -1, 5), Discrete(2), 10)

    def _start(self, rng: Any) -> None:
        self.coins, self.worth = [-1, -1], int(rng.integers(1, 6))

    def _tick(self, actions: Any) -> None:
        self.coins = [int(actions["matcher"]), int(actions["hider"])]
        won = self.worth if self.coins[0] == self.coins[1] else -self.worth
        self._pay("matcher", won)
        self._pay("hider", -won)
        self.worth = int(self.rng.integers(1, 6))

    def _look(self, agent: str) -> Any:
        return vector(*self.coins, self.worth)


PENNIES = Form(
    name="pennies",
    api="parallel",
    stages=(("matcher", "hider"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"coin": Part("all", "all", "zero-sum")},
    endings={"time": TIME},
    symmetric={"matcher": None, "hider": None},
    horizon=10,
    influence=links(
        "matcher hider reward 0",
        "hider matcher reward 0",
        "matcher hider observation 1",
        "hider matcher observation 1",
    ),
    order_sensitive="none",
    advice="parallel",
)


class Scales(Ticks):
    """Two traders lay 0 to 3 grains on their pan; one of the scales is false.

    The heavier pan is paid its difference. A grain of `trader_0` counts for two, which neither name
    nor space tells: the agents look alike and aren't.
    """

    def __init__(self) -> None:
        super().__init__(names("trader", 2), box(1, 0, 20), Discrete(4), 15)

    def _start(self, rng: Any) -> None:
        self.price = int(rng.integers(1, 10))

    def _tick(self, actions: Any) -> None:
        difference = 2 * int(actions["trader_0"]) - int(actions["trader_1"])
        if difference > 0:
            self._pay("trader_0", difference * self.price)
        if difference < 0:
            self._pay("trader_1", -difference * self.price)
        self.price = int(self.rng.integers(1, 10))

    def _look(self, agent: str) -> Any:
        return vector(self.price)


SCALES = Form(
    name="scales",
    api="parallel",
    stages=(("trader",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"difference": Part("trader", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"trader": False},
    horizon=15,
    influence=links("trader trader reward 0"),
    order_sensitive="none",
    advice="parallel",
)


class Oases(Ticks):
    """Five nomads choose one of three oases each day; all are paid the size of the largest camp."""

    def __init__(self) -> None:
        super().__init__(names("nomad", 5), box(3, 0, 5), Discrete(3), 9)

    def _start(self, rng: Any) -> None:
        self.camps = np.zeros(3)

    def _tick(self, actions: Any) -> None:
        self.camps = np.bincount([int(a) for a in actions.values()], minlength=3)
        for agent in self.agents:
            self._pay(agent, self.camps.max())

    def _look(self, agent: str) -> Any:
        return vector(*self.camps)


OASES = Form(
    name="oases",
    api="parallel",
    stages=(("nomad",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"camp": Part("nomad", "all", "shared")},
    endings={"time": TIME},
    symmetric={"nomad": True},
    horizon=9,
    influence=links("nomad nomad reward 0", "nomad nomad observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Balloon(Ticks):
    """One pilot heats or doesn't; the basket touches the ground at height 0 and the flight ends."""

    def __init__(self) -> None:
        super().__init__(names("pilot", 1), box(1, -10, 60), Discrete(2), 30)

    def _start(self, rng: Any) -> None:
        self.height = float(rng.integers(3, 7))

    def _tick(self, actions: Any) -> None:
        self.height += 1.0 if int(actions["pilot_0"]) else -1.0
        self._pay("pilot_0", 1.0)
        if self.height <= 0:
            self._end("pilot_0")

    def _look(self, agent: str) -> Any:
        return vector(self.height)


BALLOON = Form(
    name="balloon",
    api="parallel",
    stages=(("pilot",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"aloft": Part("pilot", "earner", "individual")},
    endings={"ground": Ending("termination", "all"), "time": TIME},
    symmetric={"pilot": None},
    horizon=30,
    influence=links(),
    order_sensitive="none",
    advice="either",
    doubtful=("endings", "conflicts", "order"),
)


class Gardens(Ticks):
    """Three gardeners water their own bed, each behind a wall: no agent touches another.

    A bed dries by one a day and gains two by watering; it pays 1 between 4 and 8.
    """

    def __init__(self) -> None:
        super().__init__(names("gardener", 3), box(1, -40, 60), Discrete(2), 20)

    def _start(self, rng: Any) -> None:
        self.wet = {agent: int(rng.integers(2, 9)) for agent in self.possible_agents}

    def _tick(self, actions: Any) -> None:
        for agent in self.agents:
            self.wet[agent] += 2 * int(actions[agent]) - 1
            self._pay(agent, 4 <= self.wet[agent] <= 8)

    def _look(self, agent: str) -> Any:
        return vector(self.wet[agent])


GARDENS = Form(
    name="gardens",
    api="parallel",
    stages=(("gardener",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"bed": Part("gardener", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"gardener": True},
    horizon=20,
    influence=links(),
    order_sensitive="none",
    advice="either",
)

FORMS = (
    (Dilemma, DILEMMA),
    (Pennies, PENNIES),
    (Scales, SCALES),
    (Oases, OASES),
    (Balloon, BALLOON),
    (Gardens, GARDENS),
)
