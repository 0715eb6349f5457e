"""Orders that decide and orders that have no effect (held back)."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Discrete, MultiDiscrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Form, Part, links


class Parking(Turns):
    """Four cars look for the one free space, the last of the roster first; nobody sees it go.

    Action 1 to 3 tries the street of that number; the space is in a drawn one, which is shown.
    """

    def __init__(self) -> None:
        super().__init__(names("car", 4), box(1, 0, 4), Discrete(4), 21)

    def _start(self, rng: Any) -> None:
        self.street, self.free = int(rng.integers(1, 4)), True

    def _order(self) -> list[str]:
        return self._live()[::-1]

    def _act(self, agent: str, action: Any) -> None:
        if self.free and int(action) == self.street:
            self.free = False
            self._pay(agent, 3.0)
        elif int(action):
            self._pay(agent, -0.5)

    def _close(self) -> None:
        self.street, self.free = int(self.rng.integers(1, 4)), True

    def _look(self, agent: str) -> Any:
        return vector(self.street)


PARKING = Form(
    name="parking",
    api="aec",
    stages=(("car",),),
    order="fixed",
    observe="after tick",
    conflicts="ordered",
    rewards={
        "space": Part("car", "earner", "individual"),
        "fuel": Part("car", "earner", "individual"),
    },
    endings={"time": TIME},
    symmetric={"car": False},
    horizon=21,
    influence=links("car car reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("reward",),
)


class Fountain(Turns):
    """Three pigeons bid (amount 0 to 2, side 0 to 1) for crumbs in a rotating order, eyes closed.

    Each side of the fountain holds 3 crumbs a round; a pigeon eats what it asks while they last.
    """

    def __init__(self) -> None:
        super().__init__(names("pigeon", 3), box(1, -9, 9), MultiDiscrete([3, 2]), 15)

    def _start(self, rng: Any) -> None:
        self.crumbs, self.sun = [3, 3], int(rng.integers(0, 9))

    def _order(self) -> list[str]:
        live, first = self._live(), self.t % 3
        return live[first:] + live[:first]

    def _act(self, agent: str, action: Any) -> None:
        amount, side = int(action[0]), int(action[1])
        eaten = min(amount, self.crumbs[side])
        self.crumbs[side] -= eaten
        self._pay(agent, eaten)

    def _close(self) -> None:
        self.crumbs, self.sun = [3, 3], int(self.rng.integers(0, 9))

    def _look(self, agent: str) -> Any:
        return vector(self.sun)


FOUNTAIN = Form(
    name="fountain",
    api="aec",
    stages=(("pigeon",),),
    order="rotating",
    observe="after tick",
    conflicts="ordered",
    rewards={"crumbs": Part("pigeon", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"pigeon": None},
    horizon=15,
    influence=links("pigeon pigeon reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("reward",),
)


class Shelf(Ticks):
    """Two pickers and a packer step on a line of 5 cells at once; a cell holds one robot.

    Robots are moved in the order of `agents`: a step into a cell that is taken then comes to
    nothing. The cell of the parcel (drawn) pays 1 to the robot on it, and the parcel moves on.
    """

    def __init__(self) -> None:
        super().__init__([*names("picker", 2), "packer_0"], box(4, 0, 5), Discrete(3), 33)

    def _start(self, rng: Any) -> None:
        places = rng.permutation(5).tolist()
        self.at = dict(zip(self.possible_agents, places[:3], strict=True))
        self.parcel = places[3]

    def _tick(self, actions: Any) -> None:
        for agent in self.agents:
            to = min(4, max(0, self.at[agent] + int(actions[agent]) - 1))
            if to not in self.at.values():
                self.at[agent] = to
        for agent in self.agents:
            if self.at[agent] == self.parcel:
                self._pay(agent, 1.0)
        if self.parcel in self.at.values():
            self.parcel = (self.parcel + 2) % 5

    def _look(self, agent: str) -> Any:
        others = [self.at[other] for other in self.possible_agents if other != agent]
        return vector(self.at[agent], *others, self.parcel)


SHELF = Form(
    name="shelf",
    api="parallel",
    stages=(("picker", "packer"),),
    order="none",
    observe="after tick",
    conflicts="priority",
    priority="roster",
    rewards={"parcel": Part("all", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"picker": False, "packer": None},
    horizon=33,
    influence=links(
        *[
            f"{a} {b} {on}"
            for a, b in (("picker", "picker"), ("picker", "packer"), ("packer", "picker"))
            for on in ("observation 1",)
        ],
        "picker picker reward 0",
        "picker packer reward 0",
        "packer picker reward 1",
    ),
    order_sensitive="none",
    advice="aec",
    because=("state",),
    doubtful=("order", "advice", "because", "order_sensitive"),
)


class Buffet(Ticks):
    """Four guests take 0 to 3 plates of a table of 5 at once, served as the caller lists them."""

    def __init__(self) -> None:
        super().__init__(names("guest", 4), box(2, 0, 9), Discrete(4), 13)

    def _start(self, rng: Any) -> None:
        self.dish, self.left = int(rng.integers(1, 6)), 0

    def _tick(self, actions: Any) -> None:
        self.left = 5
        for agent, plates in actions.items():
            got = min(int(plates), self.left)
            self.left -= got
            self._pay(agent, got * self.dish)
        self.dish = int(self.rng.integers(1, 6))

    def _look(self, agent: str) -> Any:
        return vector(self.dish, self.left)


BUFFET = Form(
    name="buffet",
    api="parallel",
    stages=(("guest",),),
    order="none",
    observe="after tick",
    conflicts="priority",
    priority="dictionary",
    rewards={"plates": Part("guest", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"guest": None},
    horizon=13,
    influence=links("guest guest reward 0", "guest guest observation 1"),
    order_sensitive="outcome",
    advice=None,
    doubtful=("order",),
)


class Anglers(Ticks):
    """Three anglers cast 0 to 2 lines; the catch on each is drawn in the dictionary's order.

    All see the sum of all catches, and each is paid its own: other draws, the same game.
    """

    def __init__(self) -> None:
        super().__init__(names("angler", 3), box(1, 0, 40), Discrete(3), 19)

    def _start(self, rng: Any) -> None:
        self.total = 0.0

    def _tick(self, actions: Any) -> None:
        catches = {a: int(lines) * int(self.rng.integers(0, 5)) for a, lines in actions.items()}
        self.total = float(sum(catches.values()))
        for agent in self.agents:
            self._pay(agent, catches[agent])

    def _look(self, agent: str) -> Any:
        return vector(self.total)


ANGLERS = Form(
    name="anglers",
    api="parallel",
    stages=(("angler",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"catch": Part("angler", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"angler": True},
    horizon=19,
    influence=links("angler angler observation 1"),
    order_sensitive="draws",
    advice="parallel",
    doubtful=("advice",),
)


class Ballot(Turns):
    """Five voters hand in a ballot (option 0 to 2) in drawn order; it is counted when all are in.

    The option with most votes is chosen (a tie chooses none); each voter is paid its own liking of
    it, drawn anew each round. The chosen option is told afterwards.
    """

    def __init__(self) -> None:
        super().__init__(names("voter", 5), box(4, -1, 9), Discrete(3), 10)

    def _start(self, rng: Any) -> None:
        self.liking, self.ballots, self.chosen = rng.integers(0, 9, (5, 3)), {}, -1

    def _order(self) -> list[str]:
        live = self._live()
        return [live[i] for i in self.rng.permutation(len(live))]

    def _act(self, agent: str, action: Any) -> None:
        self.ballots[agent] = int(action)

    def _close(self) -> None:
        votes = [list(self.ballots.values()).count(option) for option in range(3)]
        self.chosen = votes.index(max(votes)) if votes.count(max(votes)) == 1 else -1
        for i, agent in enumerate(self.possible_agents):
            self._pay(agent, self.liking[i, self.chosen] if self.chosen >= 0 else 0.0)
        self.ballots, self.liking = {}, self.rng.integers(0, 9, (5, 3))

    def _look(self, agent: str) -> Any:
        return vector(*self.liking[self.possible_agents.index(agent)], self.chosen)


BALLOT = Form(
    name="ballot",
    api="aec",
    stages=(("voter",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"choice": Part("all", "all", "individual")},
    endings={"time": TIME},
    symmetric={"voter": True},
    horizon=10,
    influence=links("voter voter reward 0", "voter voter observation 1"),
    order_sensitive=None,
    advice="parallel",
    doubtful=("order",),
)


class Elevator(Ticks):
    """Six tenants call a lift to floor 1 to 3 or walk (0); one of the callers, by lot, rides.

    The lot is drawn over all tenants, whatever they do; the lift's last floor is shown to all.
    """

    def __init__(self) -> None:
        super().__init__(names("tenant", 6), box(2, 0, 4), Discrete(4), 24)

    def _start(self, rng: Any) -> None:
        self.floor, self.home = 0, rng.integers(1, 4, 6)

    def _tick(self, actions: Any) -> None:
        lot = self.rng.permutation(self.possible_agents).tolist()
        callers = [agent for agent in lot if int(actions[agent])]
        if callers:
            self.floor = int(actions[callers[0]])
            home = self.home[self.possible_agents.index(callers[0])]
            self._pay(callers[0], 2.0 if self.floor == home else 1.0)

    def _look(self, agent: str) -> Any:
        return vector(self.home[self.possible_agents.index(agent)], self.floor)


ELEVATOR = Form(
    name="elevator",
    api="parallel",
    stages=(("tenant",),),
    order="none",
    observe="after tick",
    conflicts="random",
    rewards={"ride": Part("tenant", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"tenant": True},
    horizon=24,
    influence=links("tenant tenant reward 0", "tenant tenant observation 1"),
    order_sensitive="none",
    advice="parallel",
)

FORMS = (
    (Parking, PARKING),
    (Fountain, FOUNTAIN),
    (Shelf, SHELF),
    (Buffet, BUFFET),
    (Anglers, ANGLERS),
    (Ballot, BALLOT),
    (Elevator, ELEVATOR),
)
