"""Effects that come three to eight ticks after the move."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Box, Discrete, MultiDiscrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Form, Part, links


class Canal(Ticks):
    """The upper farm lets 0 to 2 units of water go; they reach the lower farm three ticks later.

    Each farm is paid the water it uses: the upper one what it keeps of 2 in the same tick, the
    lower one what arrives, if it has its sluice open then. Both see the weather alone.
    """

    def __init__(self) -> None:
        acts = {"upper": Discrete(3), "lower": Discrete(2)}
        super().__init__(["upper_0", "lower_0"], box(1, 0, 10), acts, 26)

    def _start(self, rng: Any) -> None:
        self.flow, self.weather = [0, 0, 0], int(rng.integers(0, 10))

    def _tick(self, actions: Any) -> None:
        self.flow.append(int(actions["upper_0"]))
        self._pay("upper_0", 2 - self.flow[-1])
        self._pay("lower_0", self.flow.pop(0) * int(actions["lower_0"]))
        self.weather = int(self.rng.integers(0, 10))

    def _look(self, agent: str) -> Any:
        return vector(self.weather)


CANAL = Form(
    name="canal",
    api="parallel",
    stages=(("upper", "lower"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "kept": Part("upper", "earner", "individual"),
        "water": Part("upper", "lower", "individual", 3),
    },
    endings={"time": TIME},
    symmetric={"upper": None, "lower": None},
    horizon=26,
    influence=links("upper lower reward 3"),
    order_sensitive="none",
    advice="parallel",
    doubtful=("advice",),
)


class Letters(Ticks):
    """Two sisters guess each other's mood; what one writes is read by the other five ticks later.

    An action is (guess of the other's mood, letter); moods are drawn at the start and stay.
    """

    def __init__(self) -> None:
        super().__init__(names("sister", 2), box(2, -1, 4), MultiDiscrete([3, 3]), 28)

    def _start(self, rng: Any) -> None:
        self.mood = dict(zip(self.possible_agents, rng.integers(0, 3, 2).tolist(), strict=True))
        self.post = {agent: [-1] * 5 for agent in self.possible_agents}

    def _tick(self, actions: Any) -> None:
        for agent, other in (("sister_0", "sister_1"), ("sister_1", "sister_0")):
            guess, letter = (int(x) for x in actions[agent])
            self._pay(agent, guess == self.mood[other])
            self.post[other] = [*self.post[other][1:], letter]

    def _look(self, agent: str) -> Any:
        return vector(self.mood[agent], self.post[agent][0])


LETTERS = Form(
    name="letters",
    api="parallel",
    stages=(("sister",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"guess": Part("sister", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"sister": True},
    horizon=28,
    messages=("action[1]", "observation[1]"),
    influence=links("sister sister observation 5"),
    order_sensitive="none",
    advice="parallel",
    doubtful=("advice",),
)


class Glacier(Ticks):
    """Three plants burn between 0 and 1; each is paid what it burns, and all pay eight ticks later.

    The bill of a tick is half of all that was burnt eight ticks before. Nothing else is seen than
    one's own last output.
    """

    def __init__(self) -> None:
        super().__init__(names("plant", 3), box(1, 0, 1), Box(0, 1, (1,), "float32"), 30)

    def _start(self, rng: Any) -> None:
        self.burnt, self.last = [0.0] * 8, dict.fromkeys(self.possible_agents, 0.0)
        self.wind = float(rng.uniform(0.5, 1.5))

    def _tick(self, actions: Any) -> None:
        self.last = {a: float(min(1.0, max(0.0, actions[a][0]))) for a in self.agents}
        bill = self.burnt.pop(0) / 2
        self.burnt.append(sum(self.last.values()))
        for agent in self.agents:
            self._pay(agent, self.wind * self.last[agent] - bill)

    def _look(self, agent: str) -> Any:
        return vector(self.last[agent])


GLACIER = Form(
    name="glacier",
    api="parallel",
    stages=(("plant",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "output": Part("plant", "earner", "individual"),
        "bill": Part("plant", "all", "shared", 8),
    },
    endings={"time": TIME},
    symmetric={"plant": True},
    horizon=30,
    influence=links("plant plant reward 8"),
    order_sensitive="none",
    advice="parallel",
    doubtful=("advice",),
)


class Orders(Turns):
    """A shop orders 0 to 4 barrels in its turn; after it, the brewery ships 0 to 4 of its own.

    The brewery sees the order at once, the shop the beer four rounds after it was shipped: then the
    shop sells at most what it then orders and both are paid the sale.
    """

    def __init__(self) -> None:
        super().__init__(["shop_0", "brewery_0"], box(1, 0, 20), Discrete(5), 24)

    def _start(self, rng: Any) -> None:
        self.road, self.order = [int(x) for x in rng.integers(0, 3, 4)], 0

    def _act(self, agent: str, action: Any) -> None:
        if agent == "shop_0":
            self.order = int(action)
            return
        arrived = self.road.pop(0)
        self.road.append(int(action))
        for each in self.agents:
            self._pay(each, min(arrived, self.order))

    def _look(self, agent: str) -> Any:
        return vector(self.order if agent == "brewery_0" else self.road[0])


ORDERS = Form(
    name="orders",
    api="aec",
    stages=(("shop",), ("brewery",)),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"sale": Part("all", "all", "shared", None)},
    endings={"time": TIME},
    symmetric={"shop": None, "brewery": None},
    horizon=24,
    influence=links(
        "shop brewery observation 0",
        "shop brewery reward 0",
        "brewery shop observation 4",
        "brewery shop reward 4",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state",),
    doubtful=("conflicts",),
)

FORMS = ((Canal, CANAL), (Letters, LETTERS), (Glacier, GLACIER), (Orders, ORDERS))
