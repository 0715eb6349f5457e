"""Messages: a guide and a walker, a haggle in turns, and a team on one radio channel."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Discrete, MultiDiscrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Blindfold(Ticks):
    """A guide sees one of four doors and says a word; a walker hears it in the next tick.

    The walker opens a door; both are paid 1 for the right one, and another is drawn every tick.
    """

    def __init__(self) -> None:
        acts = {"guide": Discrete(4), "walker": Discrete(4)}
        super().__init__(["guide_0", "walker_0"], box(2, -1, 4), acts, 15)

    def _start(self, rng: Any) -> None:
        self.door, self.word, self.opened = int(rng.integers(4)), -1, -1

    def _tick(self, actions: Any) -> None:
        self.opened = int(actions["walker_0"])
        for agent in self.agents:
            self._pay(agent, self.opened == self.door)
        self.door, self.word = int(self.rng.integers(4)), int(actions["guide_0"])

    def _look(self, agent: str) -> Any:
        return vector(self.door, self.opened) if agent == "guide_0" else vector(-1, self.word)


BLINDFOLD = Form(
    name="blindfold",
    api="parallel",
    stages=(("guide", "walker"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"door": Part("walker", "all", "shared")},
    endings={"time": TIME},
    symmetric={"guide": None, "walker": None},
    horizon=15,
    messages=("action", "observation[1]"),
    influence=links(
        "guide walker observation 1", "walker guide observation 1", "walker guide reward 0"
    ),
    order_sensitive="none",
    advice="parallel",
    doubtful=("messages",),
)


class Haggle(Turns):
    """A seller and a buyer take turns: (word, offer, 5 to agree) until they agree on an offer.

    The other's word and offer are seen at once; one between cost and worth can be agreed to.
    It pays the price minus the cost to the seller and the worth minus the price to the buyer.
    Without a deal in 10 rounds nobody gains.
    """

    def __init__(self) -> None:
        acts = MultiDiscrete([3, 8, 6])
        super().__init__(["seller_0", "buyer_0"], box(3, -1, 12), acts, 10)

    def _start(self, rng: Any) -> None:
        self.worth = {"seller_0": int(rng.integers(0, 4)), "buyer_0": int(rng.integers(4, 9))}
        self.said = dict.fromkeys(self.agents, (-1, -1))

    def _act(self, agent: str, action: Any) -> None:
        word, offer, agree = (int(x) for x in action)
        price = self.said["buyer_0" if agent == "seller_0" else "seller_0"][1]
        if agree == 5 and self.worth["seller_0"] <= price <= self.worth["buyer_0"]:
            self._pay("seller_0", price - self.worth["seller_0"])
            self._pay("buyer_0", self.worth["buyer_0"] - price)
            self._end("seller_0", "buyer_0")
        self.said[agent] = (word, offer)

    def _look(self, agent: str) -> Any:
        return vector(
            self.worth[agent], *self.said["buyer_0" if agent == "seller_0" else "seller_0"]
        )


HAGGLE = Form(
    name="haggle",
    api="aec",
    stages=(("seller",), ("buyer",)),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"deal": Part("all", "all", "individual", None)},
    endings={"deal": Ending("termination", "all"), "time": TIME},
    symmetric={"seller": None, "buyer": None},
    horizon=10,
    messages=("action[0]", "observation[1]"),
    influence=links(
        "seller buyer observation 0",
        "seller buyer reward 0",
        "seller buyer ending 0",
        "buyer seller observation 1",
        "buyer seller reward 0",
        "buyer seller ending 0",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state",),
    doubtful=("rewards",),
)


class Channel(Ticks):
    """Four scouts share one channel: (send or not, word); a word alone in its tick is heard by all.

    Two that send at once jam each other. A scout guesses nothing; the team is paid 1 for a clear
    word that names the drawn color, which only `scout` agents whose lamp is lit (drawn) can see.
    """

    def __init__(self) -> None:
        super().__init__(names("scout", 4), box(2, -1, 3), MultiDiscrete([2, 3]), 21)

    def _start(self, rng: Any) -> None:
        self.heard = -1
        self._draw()

    def _draw(self) -> None:
        self.color, self.lit = int(self.rng.integers(3)), self.rng.random(4) < 0.5

    def _tick(self, actions: Any) -> None:
        words = [int(actions[a][1]) for a in self.agents if int(actions[a][0])]
        self.heard = words[0] if len(words) == 1 else -1
        for agent in self.agents:
            self._pay(agent, self.heard == self.color)
        self._draw()

    def _look(self, agent: str) -> Any:
        seen = self.color if self.lit[self.possible_agents.index(agent)] else -1
        return vector(seen, self.heard)


CHANNEL = Form(
    name="channel",
    api="parallel",
    stages=(("scout",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"word": Part("scout", "all", "shared")},
    endings={"time": TIME},
    symmetric={"scout": True},
    horizon=21,
    messages=("action[1]", "observation[1]"),
    influence=links("scout scout reward 0", "scout scout observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Market(Ticks):
    """Two sellers and three buyers name a price 0 to 9 at once; one price clears the market.

    The clearing price is the median of all prices; sellers at or below it sell to it, buyers at or
    above it buy. The price is public afterwards. Costs and worths are drawn each tick.
    """

    def __init__(self) -> None:
        agents = [*names("seller", 2), *names("buyer", 3)]
        super().__init__(agents, box(2, -1, 12), Discrete(10), 14)

    def _start(self, rng: Any) -> None:
        self.price = -1.0
        self._draw()

    def _draw(self) -> None:
        worths = self.rng.integers(0, 10, len(self.possible_agents)).tolist()
        self.worth = dict(zip(self.possible_agents, worths, strict=True))

    def _tick(self, actions: Any) -> None:
        self.price = float(np.median([int(actions[agent]) for agent in self.agents]))
        for agent in self.agents:
            named = int(actions[agent])
            if agent.startswith("seller") and named <= self.price:
                self._pay(agent, self.price - self.worth[agent])
            if agent.startswith("buyer") and named >= self.price:
                self._pay(agent, self.worth[agent] - self.price)
        self._draw()

    def _look(self, agent: str) -> Any:
        return vector(self.worth[agent], self.price)


MARKET = Form(
    name="market",
    api="parallel",
    stages=(("seller", "buyer"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "sale": Part("seller", "earner", "individual"),
        "purchase": Part("buyer", "earner", "individual"),
    },
    endings={"time": TIME},
    symmetric={"seller": True, "buyer": True},
    horizon=14,
    influence=links(
        *[
            f"{a} {b} {on}"
            for a in ("seller", "buyer")
            for b in ("seller", "buyer")
            for on in ("reward 0", "observation 1")
        ]
    ),
    order_sensitive="none",
    advice="parallel",
)

FORMS = ((Blindfold, BLINDFOLD), (Haggle, HAGGLE), (Channel, CHANNEL), (Market, MARKET))
