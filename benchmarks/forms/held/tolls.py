"""Tolls, fines, buds, fists and lockers (held back); written before any measuring."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Form, Part, links


class Strait(Turns):
    """A warden sets a toll 0 to 3; then three ships wait or pass, and don't see each other.

    A ship that passes has its worth less the toll, the warden the toll. The warden sees the number
    of ships that passed in the round before.
    """

    def __init__(self) -> None:
        acts = {"warden": Discrete(4), "ship": Discrete(2)}
        super().__init__(["warden_0", *names("ship", 3)], box(2, -1, 9), acts, 12)

    def _start(self, rng: Any) -> None:
        self.toll, self.passed, self.before = -1, 0, -1
        self.worth = rng.integers(1, 6, 4)

    def _act(self, agent: str, action: Any) -> None:
        if agent == "warden_0":
            self.toll = int(action)
        elif int(action):
            self.passed += 1
            self._pay(agent, self.worth[self.possible_agents.index(agent)] - self.toll)
            self._pay("warden_0", self.toll)

    def _close(self) -> None:
        self.before, self.passed, self.toll = self.passed, 0, -1
        self.worth = self.rng.integers(1, 6, 4)

    def _look(self, agent: str) -> Any:
        if agent == "warden_0":
            return vector(self.before, -1)
        return vector(self.worth[self.possible_agents.index(agent)], self.toll)


STRAIT = Form(
    name="strait",
    api="aec",
    stages=(("warden",), ("ship",)),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={
        "cargo": Part("ship", "earner", "individual"),
        "toll": Part("ship", "warden", "individual"),
    },
    endings={"time": TIME},
    symmetric={"warden": None, "ship": True},
    horizon=12,
    influence=links(
        "warden ship observation 0",
        "warden ship reward 0",
        "ship warden reward 0",
        "ship warden observation 1",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)


class Smog(Ticks):
    """Two firms emit 0 to 3 and are paid so much; an inspector looks at one of them, or none.

    A firm that is caught with 2 or more is fined 4 two ticks later, and the inspector is paid 1
    then; a look costs it a half. The inspector sees the smog of the tick before.
    """

    def __init__(self) -> None:
        acts = {"firm": Discrete(4), "inspector": Discrete(3)}
        super().__init__([*names("firm", 2), "inspector_0"], box(1, -1, 9), acts, 14)

    def _start(self, rng: Any) -> None:
        self.smog, self.demand = -1, rng.integers(0, 9, 2)
        self.due: list[tuple[int, str]] = []

    def _tick(self, actions: Any) -> None:
        firms = self.possible_agents[:2]
        for firm in firms:
            self._pay(firm, int(actions[firm]))
        self.smog = sum(int(actions[firm]) for firm in firms)
        for at, firm in self.due:
            if at == self.t:
                self._pay(firm, -4.0)
                self._pay("inspector_0", 1.0)
        looked = int(actions["inspector_0"])
        if looked:
            self._pay("inspector_0", -0.5)
            if int(actions[firms[looked - 1]]) >= 2:
                self.due.append((self.t + 2, firms[looked - 1]))

    def _look(self, agent: str) -> Any:
        if agent == "inspector_0":
            return vector(self.smog)
        return vector(self.demand[self.possible_agents.index(agent)])


SMOG = Form(
    name="smog",
    api="parallel",
    stages=(("firm", "inspector"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "output": Part("firm", "earner", "individual"),
        "fine": Part("inspector", "firm", "individual", 2),
        "bounty": Part("inspector", "earner", "individual", 2),
    },
    endings={"time": TIME},
    symmetric={"firm": True, "inspector": None},
    horizon=14,
    influence=links(
        "inspector firm reward 2", "firm inspector reward 2", "firm inspector observation 1"
    ),
    order_sensitive="none",
    advice="parallel",
)


class Budding(Turns):
    """Two cells of five rest (0), eat from one dish (1) or bud (2), which lets the next one join.

    A bite is paid 1 while there are any: two a round for all. A bud costs 1 and two bites.
    """

    def __init__(self) -> None:
        super().__init__(names("cell", 5), box(2, 0, 99), Discrete(3), 14)

    def _first(self) -> list[str]:
        return self.possible_agents[:2]

    def _start(self, rng: Any) -> None:
        self.dish, self.eaten = 2, dict.fromkeys(self.possible_agents, 0)
        self.warmth = int(rng.integers(0, 9))

    def _act(self, agent: str, action: Any) -> None:
        if int(action) == 1 and self.dish:
            self.dish -= 1
            self.eaten[agent] += 1
            self._pay(agent, 1.0)
        elif int(action) == 2 and self.eaten[agent] >= 2 and len(self.agents) < 5:
            self.eaten[agent] -= 2
            self._pay(agent, -1.0)
            self._join(self.possible_agents[len(self.agents)])

    def _close(self) -> None:
        self.dish = 2

    def _look(self, agent: str) -> Any:
        return vector(self.dish, self.warmth)


BUDDING = Form(
    name="budding",
    api="aec",
    stages=(("cell",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"bite": Part("cell", "earner", "individual")},
    endings={"time": TIME},
    may_join=("cell",),
    symmetric={"cell": False},
    horizon=14,
    influence=links("cell cell observation 0", "cell cell reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)


class Fists(Turns):
    """Three players show rock, paper or scissors in a rotating order, hidden to the round's end.

    Then each plays each for 1, and all see what the others showed.
    """

    def __init__(self) -> None:
        super().__init__(names("player", 3), box(4, -1, 9), Discrete(3), 15)

    def _start(self, rng: Any) -> None:
        self.hand: dict[str, int] = {}
        self.seen, self.sky = dict.fromkeys(self.possible_agents, -1), int(rng.integers(9))

    def _order(self) -> list[str]:
        live, first = self._live(), self.t % 3
        return live[first:] + live[:first]

    def _act(self, agent: str, action: Any) -> None:
        self.hand[agent] = int(action)

    def _close(self) -> None:
        for one in self._live():
            for two in self._live():
                if (self.hand[one] - self.hand[two]) % 3 == 1:
                    self._pay(one, 1.0)
                    self._pay(two, -1.0)
        self.seen = dict(self.hand)

    def _look(self, agent: str) -> Any:
        return vector(*(self.seen[each] for each in self.possible_agents), self.sky)


FISTS = Form(
    name="fists",
    api="aec",
    stages=(("player",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"win": Part("all", "all", "zero-sum")},
    endings={"time": TIME},
    symmetric={"player": True},
    horizon=15,
    influence=links("player player reward 0", "player player observation 1"),
    order_sensitive=None,
    advice="parallel",
)


class Lockers(Ticks):
    """Three swimmers choose one of four lockers, or none (4), at once; two at one get nothing.

    A locker that is had pays 1 and can't be chosen by anybody in the next two ticks.
    """

    def __init__(self) -> None:
        super().__init__(names("swimmer", 3), box(1, 0, 9), Discrete(5), 16)

    def _start(self, rng: Any) -> None:
        self.until, self.heat = [0] * 4, rng.integers(0, 9, 3)

    def _tick(self, actions: Any) -> None:
        chosen = [int(actions[agent]) for agent in self.agents]
        for agent, locker in zip(self.agents, chosen, strict=True):
            if locker < 4 and chosen.count(locker) == 1:
                self._pay(agent, 1.0)
                self.until[locker] = self.t + 2

    def _mask(self, agent: str) -> Any:
        return [*(self.t >= until for until in self.until), True]

    def _look(self, agent: str) -> Any:
        return vector(self.heat[self.possible_agents.index(agent)])


LOCKERS = Form(
    name="lockers",
    api="parallel",
    stages=(("swimmer",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    legality=True,
    rewards={"locker": Part("swimmer", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"swimmer": True},
    horizon=16,
    influence=links("swimmer swimmer mask 1", "swimmer swimmer reward 0"),
    order_sensitive="none",
    advice="parallel",
)

FORMS = ((Strait, STRAIT), (Smog, SMOG), (Budding, BUDDING), (Fists, FISTS), (Lockers, LOCKERS))
