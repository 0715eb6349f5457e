"""Cards, auctions and other tables at which players take turns or hide what they do."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Box, Dict, Discrete

from benchmarks.forms.bases import Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Trick(Turns):
    """Three players hold six of eighteen cards each; the highest card of a trick wins it.

    Players see their own hand and the cards on the table; the winner of a trick leads the next one
    (the order hangs on the state), and after six tricks the deal is over.
    """

    def __init__(self) -> None:
        observes = Dict({"observation": box(21, -1, 18), "action_mask": Box(0, 1, (18,), "int8")})
        super().__init__(names("player", 3), observes, Discrete(18), None)

    def _start(self, rng: Any) -> None:
        deck = rng.permutation(18).tolist()
        self.hand = {a: set(deck[6 * i : 6 * i + 6]) for i, a in enumerate(self.possible_agents)}
        self.table: dict[str, int] = {}
        self.leader = int(rng.integers(3))

    def _order(self) -> list[str]:
        return self.possible_agents[self.leader :] + self.possible_agents[: self.leader]

    def _act(self, agent: str, action: Any) -> None:
        card = int(action) if int(action) in self.hand[agent] else min(self.hand[agent])
        self.hand[agent].discard(card)
        self.table[agent] = card

    def _close(self) -> None:
        winner = max(self.table, key=self.table.__getitem__)
        self._pay(winner, 1.0)
        self.leader, self.table = self.possible_agents.index(winner), {}
        if not self.hand[winner]:
            self._end(*self.possible_agents)

    def _look(self, agent: str) -> Any:
        own = [float(card in self.hand[agent]) for card in range(18)]
        table = [self.table.get(each, -1) for each in self.possible_agents]
        mask = vector(*own).astype("int8") if any(own) else vector(*[1] * 18).astype("int8")
        return {"observation": vector(*own, *table), "action_mask": mask}


TRICK = Form(
    name="trick",
    api="aec",
    stages=(("player",),),
    order="state",
    observe="after turn",
    conflicts="joint rule",
    rewards={"trick": Part("player", "earner", "individual")},
    endings={"played": Ending("termination", "all")},
    symmetric={"player": True},
    horizon=None,
    influence=links("player player observation 0", "player player reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
    doubtful=("conflicts", "horizon"),
)


class Nim(Turns):
    """Two players take 1 to 3 stones of a heap in turn; the one that takes the last one wins."""

    def __init__(self) -> None:
        super().__init__(names("player", 2), box(1, 0, 40), Discrete(3), None)

    def _start(self, rng: Any) -> None:
        self.heap = int(rng.integers(11, 24))

    def _act(self, agent: str, action: Any) -> None:
        self.heap -= min(1 + int(action), self.heap)
        if self.heap == 0:
            other = "player_1" if agent == "player_0" else "player_0"
            self._pay(agent, 1.0)
            self._pay(other, -1.0)
            self._end(agent, other)

    def _mask(self, agent: str) -> Any:
        return [1, self.heap >= 2, self.heap >= 3]

    def _look(self, agent: str) -> Any:
        return vector(self.heap)


NIM = Form(
    name="nim",
    api="aec",
    stages=(("player",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    legality=True,
    rewards={"win": Part("player", "all", "zero-sum")},
    endings={"empty": Ending("termination", "all")},
    symmetric={"player": False},
    horizon=None,
    influence=links(
        "player player observation 0",
        "player player mask 0",
        "player player reward 0",
        "player player ending 0",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state", "legality"),
)


class SealedBids(Turns):
    """Four bidders write 0 to 5 in turn; the highest bid alone wins the lot and pays its bid.

    A bidder sees its own worth of the lot; bids are opened when all are written, and the last price
    is told to all in the next round. Equal highest bids sell nothing.
    """

    def __init__(self) -> None:
        super().__init__(names("bidder", 4), box(2, -1, 9), Discrete(6), 8)

    def _start(self, rng: Any) -> None:
        self.worth, self.bids, self.price = rng.integers(2, 9, 4), {}, -1

    def _act(self, agent: str, action: Any) -> None:
        self.bids[agent] = int(action)

    def _close(self) -> None:
        high = max(self.bids.values())
        best = [agent for agent, bid in self.bids.items() if bid == high]
        if len(best) == 1:
            self._pay(best[0], self.worth[self.possible_agents.index(best[0])] - high)
        self.price = high if len(best) == 1 else -1
        self.bids, self.worth = {}, self.rng.integers(2, 9, 4)

    def _look(self, agent: str) -> Any:
        return vector(self.worth[self.possible_agents.index(agent)], self.price)


SEALED_BIDS = Form(
    name="sealed_bids",
    api="aec",
    stages=(("bidder",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"gain": Part("bidder", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"bidder": True},
    horizon=8,
    influence=links("bidder bidder reward 0", "bidder bidder observation 1"),
    order_sensitive=None,
    advice="parallel",
)


class Outcry(Turns):
    """Three dealers pass (0) or raise the open price to 1 to 9; lower bids are masked.

    When a whole round passes, the standing bidder has the lot for its price and the sale is over.
    """

    def __init__(self) -> None:
        super().__init__(names("dealer", 3), box(3, 0, 30), Discrete(10), None)

    def _start(self, rng: Any) -> None:
        self.worth = dict(zip(self.possible_agents, rng.integers(3, 25, 3).tolist(), strict=True))
        self.price, self.holder, self.raised = 0, None, False

    def _act(self, agent: str, action: Any) -> None:
        if int(action) > self.price:
            self.price, self.holder, self.raised = int(action), agent, True

    def _close(self) -> None:
        if not self.raised:
            if self.holder:
                self._pay(self.holder, self.worth[self.holder] - self.price)
            self._end(*self.possible_agents)
        self.raised = False

    def _mask(self, agent: str) -> Any:
        return [1, *(bid > self.price for bid in range(1, 10))]

    def _look(self, agent: str) -> Any:
        return vector(self.worth[agent], self.price, self.holder == agent)


OUTCRY = Form(
    name="outcry",
    api="aec",
    stages=(("dealer",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    legality=True,
    rewards={"gain": Part("dealer", "earner", "individual", None)},
    endings={"sold": Ending("termination", "all")},
    symmetric={"dealer": False},
    horizon=None,
    influence=links(
        "dealer dealer observation 0",
        "dealer dealer mask 0",
        "dealer dealer reward 0",
        "dealer dealer ending 0",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state", "legality"),
)


class Contract(Turns):
    """Four players bid for a contract, as in bridge: a bid is 1 to 3 above the last, 0 passes.

    Partners sit opposite. After a round of passes, or bid 7, the last bidder's side makes its bid
    if the aces of both its hands reach it: it gains the bid, or loses it, from the other side.
    """

    def __init__(self) -> None:
        observes = Dict({"observation": box(2, 0, 9), "action_mask": Box(0, 1, (8,), "int8")})
        super().__init__(names("player", 4), observes, Discrete(8), None)

    def _start(self, rng: Any) -> None:
        self.aces = dict(zip(self.possible_agents, rng.integers(0, 5, 4).tolist(), strict=True))
        self.bid, self.side, self.passes = 0, None, 0

    def _act(self, agent: str, action: Any) -> None:
        if int(action) > self.bid:
            self.bid, self.side, self.passes = int(action), int(agent[-1]) % 2, 0
        else:
            self.passes += 1
        if self.passes == 4 or self.bid == 7:
            self._settle()

    def _settle(self) -> None:
        if self.side is not None:
            mine = [a for a in self.possible_agents if int(a[-1]) % 2 == self.side]
            made = sum(self.aces[a] for a in mine) >= self.bid
            for agent in self.possible_agents:
                self._pay(agent, self.bid if (agent in mine) == made else -self.bid)
        self._end(*self.possible_agents)

    def _look(self, agent: str) -> Any:
        mask = vector(1, *(0 < bid - self.bid <= 3 for bid in range(1, 8))).astype("int8")
        return {"observation": vector(self.aces[agent], self.bid), "action_mask": mask}


CONTRACT = Form(
    name="contract",
    api="aec",
    stages=(("player",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    legality=True,
    rewards={"contract": Part("player", "all", "zero-sum", None)},
    endings={"made": Ending("termination", "all")},
    symmetric={"player": False},
    horizon=None,
    influence=links(
        "player player observation 0",
        "player player mask 0",
        "player player reward 0",
        "player player ending 0",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state", "legality"),
)

FORMS = (
    (Trick, TRICK),
    (Nim, NIM),
    (SealedBids, SEALED_BIDS),
    (Outcry, OUTCRY),
    (Contract, CONTRACT),
)
