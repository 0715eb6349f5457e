"""Cards, dice, offers and prices (held back)."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Kuhn(Turns):
    """Kuhn's poker with 6 cards: ante 1, then check or bet (1) and fold or call, in turn.

    Both see the moves so far and their own card. The higher card wins the pot from the other.
    """

    def __init__(self) -> None:
        super().__init__(names("player", 2), box(4, -1, 6), Discrete(2), None)

    def _start(self, rng: Any) -> None:
        self.card = dict(zip(self.possible_agents, rng.permutation(6)[:2].tolist(), strict=True))
        self.moves: list[int] = []

    def _act(self, agent: str, action: Any) -> None:
        self.moves.append(int(action))
        other = "player_1" if agent == "player_0" else "player_0"
        if self.moves[-2:] == [1, 0]:
            self._settle(other, agent, 1.0)
        elif self.moves in ([0, 0], [1, 1], [0, 1, 1]):
            high, low = sorted((agent, other), key=self.card.__getitem__, reverse=True)
            self._settle(high, low, 1.0 + self.moves[-1])

    def _settle(self, winner: str, loser: str, pot: float) -> None:
        self._pay(winner, pot)
        self._pay(loser, -pot)
        self._end(winner, loser)

    def _look(self, agent: str) -> Any:
        moves = [*self.moves, -1, -1, -1][:3]
        return vector(self.card[agent], *moves)


KUHN = Form(
    name="kuhn",
    api="aec",
    stages=(("player",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"pot": Part("all", "all", "zero-sum", None)},
    endings={"settled": Ending("termination", "all")},
    symmetric={"player": False},
    horizon=None,
    influence=links(
        "player player observation 0", "player player reward 0", "player player ending 0"
    ),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)


class Ultimatum(Turns):
    """A proposer offers 0 to 5 of 5 coins and a responder takes (1) or refuses (0); 8 rounds."""

    def __init__(self) -> None:
        acts = {"proposer": Discrete(6), "responder": Discrete(2)}
        super().__init__(["proposer_0", "responder_0"], box(2, -1, 9), acts, 8)

    def _start(self, rng: Any) -> None:
        self.offer, self.taken, self.coin = -1, -1, int(rng.integers(1, 5))

    def _act(self, agent: str, action: Any) -> None:
        if agent == "proposer_0":
            self.offer = int(action)
            return
        self.taken = int(action)
        if self.taken:
            self._pay("proposer_0", (5 - self.offer) * self.coin)
            self._pay("responder_0", self.offer * self.coin)

    def _close(self) -> None:
        self.offer, self.coin = -1, int(self.rng.integers(1, 5))

    def _look(self, agent: str) -> Any:
        return vector(self.coin, self.taken if agent == "proposer_0" else self.offer)


ULTIMATUM = Form(
    name="ultimatum",
    api="aec",
    stages=(("proposer",), ("responder",)),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"coins": Part("responder", "all", "individual")},
    endings={"time": TIME},
    symmetric={"proposer": None, "responder": None},
    horizon=8,
    influence=links(
        "proposer responder observation 0",
        "proposer responder reward 0",
        "responder proposer observation 1",
        "responder proposer reward 0",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state",),
    doubtful=("rewards",),
)


class Clock(Ticks):
    """A falling price: four florists shout (4) or wait (0 to 3) at once; a lone first shout buys.

    Of several that shout in one tick none buys and the lot is withdrawn. All then see a new lot.
    """

    def __init__(self) -> None:
        super().__init__(names("florist", 4), box(2, 0, 20), Discrete(5), 20)

    def _start(self, rng: Any) -> None:
        self.worth = rng.integers(2, 12, 4)
        self.price = 10

    def _tick(self, actions: Any) -> None:
        shouts = [a for a in self.agents if int(actions[a]) == 4]
        if len(shouts) == 1:
            self._pay(shouts[0], self.worth[self.possible_agents.index(shouts[0])] - self.price)
        fresh = self.rng.integers(2, 12, 4)
        self.price -= 1
        if shouts or self.price == 0:
            self.price, self.worth = 10, fresh

    def _look(self, agent: str) -> Any:
        return vector(self.worth[self.possible_agents.index(agent)], self.price)


CLOCK = Form(
    name="clock",
    api="parallel",
    stages=(("florist",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"gain": Part("florist", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"florist": True},
    horizon=20,
    influence=links("florist florist reward 0", "florist florist observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Whisper(Turns):
    """Five children pass a word on: each hears the one before it in this round, then says a word.

    (word, loudness): a loud word is heard as it is, a soft one is one off by chance. The last
    word's distance from the first child's drawn word is paid by all.
    """

    def __init__(self) -> None:
        super().__init__(names("child", 5), box(1, -1, 8), MultiDiscrete([8, 2]), 9)

    def _start(self, rng: Any) -> None:
        self.secret = int(rng.integers(8))
        self.heard, self.speaker = self.secret, -1

    def _act(self, agent: str, action: Any) -> None:
        slip = int(self.rng.integers(0, 2))
        word = (int(action[0]) + (0 if int(action[1]) else slip)) % 8
        self.heard = word
        self.speaker = self.possible_agents.index(agent)
        if self.speaker == 4:
            for each in self.agents:
                self._pay(each, -abs(word - self.secret))

    def _close(self) -> None:
        self.secret = int(self.rng.integers(8))
        self.heard, self.speaker = self.secret, -1

    def _look(self, agent: str) -> Any:
        turn = self.possible_agents.index(agent) == self.speaker + 1
        return vector(self.heard if turn else -1)


WHISPER = Form(
    name="whisper",
    api="aec",
    stages=(("child",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"distance": Part("child", "all", "shared")},
    endings={"time": TIME},
    symmetric={"child": False},
    horizon=9,
    messages=("action[0]", "observation[0]"),
    influence=links("child child observation 0", "child child reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)


class Cournot(Ticks):
    """Eight firms choose an output from 0 to 2 at once; the price falls with the sum of them."""

    def __init__(self) -> None:
        super().__init__(names("firm", 8), box(2, -9, 20), Box(0, 2, (1,), np.float32), 16)

    def _start(self, rng: Any) -> None:
        self.demand, self.price = float(rng.uniform(8, 12)), 0.0

    def _tick(self, actions: Any) -> None:
        output = {a: float(np.clip(actions[a][0], 0, 2)) for a in self.agents}
        self.price = self.demand - sum(output[a] for a in self.agents)
        for agent in self.agents:
            self._pay(agent, self.price * output[agent])
        self.demand = float(self.rng.uniform(8, 12))

    def _look(self, agent: str) -> Any:
        return vector(self.demand, self.price)


COURNOT = Form(
    name="cournot",
    api="parallel",
    stages=(("firm",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"profit": Part("firm", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"firm": True},
    horizon=16,
    influence=links("firm firm reward 0", "firm firm observation 1"),
    order_sensitive="none",
    advice="parallel",
)

FORMS = (
    (Kuhn, KUHN),
    (Ultimatum, ULTIMATUM),
    (Clock, CLOCK),
    (Whisper, WHISPER),
    (Cournot, COURNOT),
)
