"""Lots, queues, juries and inspections (held back); the forms were written before any measuring."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Podium(Turns):
    """Three runners choose a pace 0 to 3 in turn; the faster ones go first in the next round.

    The first pace of 2 or more in a round earns 2, and a pace costs half of itself. The last pace
    is seen by all.
    """

    def __init__(self) -> None:
        super().__init__(names("runner", 3), box(2, -1, 4), Discrete(4), 12)

    def _start(self, rng: Any) -> None:
        self.pace = dict(zip(self.possible_agents, rng.permutation(3).tolist(), strict=True))
        self.shown, self.is_won = -1, False

    def _order(self) -> list[str]:
        return sorted(self._live(), key=lambda agent: -self.pace[agent])

    def _act(self, agent: str, action: Any) -> None:
        self.pace[agent] = self.shown = int(action)
        self._pay(agent, -self.shown / 2)
        if self.shown >= 2 and not self.is_won:
            self.is_won = True
            self._pay(agent, 2.0)

    def _close(self) -> None:
        self.is_won = False

    def _look(self, agent: str) -> Any:
        return vector(self.pace[agent], self.shown)


PODIUM = Form(
    name="podium",
    api="aec",
    stages=(("runner",),),
    order="state",
    observe="after turn",
    conflicts="ordered",
    rewards={"pace": Part("runner", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"runner": None},
    horizon=12,
    influence=links("runner runner observation 0", "runner runner reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)


class Jury(Ticks):
    """Five jurors vote at once until they are of one mind: 1 for all if it is right, else -1.

    All see the number of guilty votes of the tick before.
    """

    def __init__(self) -> None:
        super().__init__(names("juror", 5), box(2, -1, 5), Discrete(2), 10)

    def _start(self, rng: Any) -> None:
        self.guilty, self.votes = int(rng.integers(2)), -1
        self.hint = rng.integers(0, 2, 5)

    def _tick(self, actions: Any) -> None:
        self.votes = sum(int(actions[agent]) for agent in self.agents)
        if self.votes in (0, 5):
            for agent in self.agents:
                self._pay(agent, 1.0 if self.votes == 5 * self.guilty else -1.0)
            self._end(*self.agents)

    def _look(self, agent: str) -> Any:
        return vector(self.hint[self.possible_agents.index(agent)], self.votes)


JURY = Form(
    name="jury",
    api="parallel",
    stages=(("juror",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"verdict": Part("juror", "all", "shared")},
    endings={"verdict": Ending("termination", "all"), "time": TIME},
    symmetric={"juror": True},
    horizon=10,
    influence=links("juror juror reward 0", "juror juror ending 0", "juror juror observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Hammer(Ticks):
    """Four bidders name 0 to 4 at once; the highest pays the second price, and a lot breaks ties.

    The lot is drawn over all bidders in every tick. The price is seen by all.
    """

    def __init__(self) -> None:
        super().__init__(names("bidder", 4), box(2, -1, 9), Discrete(5), 16)

    def _start(self, rng: Any) -> None:
        self.price, self.worth = -1, rng.integers(3, 9, 4)

    def _tick(self, actions: Any) -> None:
        lot = self.rng.permutation(4).tolist()
        bids = [int(actions[agent]) for agent in self.possible_agents]
        winner = max(range(4), key=lambda at: (bids[at], lot[at]))
        self.price = sorted(bids)[-2]
        self._pay(self.possible_agents[winner], self.worth[winner] - self.price)
        self.worth = self.rng.integers(3, 9, 4)

    def _look(self, agent: str) -> Any:
        return vector(self.worth[self.possible_agents.index(agent)], self.price)


HAMMER = Form(
    name="hammer",
    api="parallel",
    stages=(("bidder",),),
    order="none",
    observe="after tick",
    conflicts="random",
    rewards={"gain": Part("bidder", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"bidder": True},
    horizon=16,
    influence=links("bidder bidder reward 0", "bidder bidder observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Pump(Ticks):
    """Four farmers ask for water or don't; of those that ask the one that waited longest has it.

    It goes to the end of the queue, whose order is drawn at the start; each sees its own place.
    """

    def __init__(self) -> None:
        super().__init__(names("farmer", 4), box(1, 0, 4), Discrete(2), 18)

    def _start(self, rng: Any) -> None:
        self.queue = [self.possible_agents[at] for at in rng.permutation(4)]

    def _tick(self, actions: Any) -> None:
        asking = [agent for agent in self.queue if int(actions[agent])]
        if asking:
            self._pay(asking[0], 1.0)
            self.queue.remove(asking[0])
            self.queue.append(asking[0])

    def _look(self, agent: str) -> Any:
        return vector(self.queue.index(agent))


PUMP = Form(
    name="pump",
    api="parallel",
    stages=(("farmer",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"water": Part("farmer", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"farmer": True},
    horizon=18,
    influence=links("farmer farmer reward 0", "farmer farmer observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Chairs(Ticks):
    """Five dancers name 0 to 5 at once; a lone lowest number is out, a lone highest is paid 1.

    The last one left goes on to the end. All see the lowest number of the tick before.
    """

    def __init__(self) -> None:
        super().__init__(names("dancer", 5), box(2, -1, 9), Discrete(6), 15)

    def _start(self, rng: Any) -> None:
        self.low, self.tune = -1, int(rng.integers(9))

    def _tick(self, actions: Any) -> None:
        named = {agent: int(actions[agent]) for agent in self.agents}
        self.low, high = min(named.values()), max(named.values())
        for agent, number in named.items():
            is_alone = list(named.values()).count(number) == 1
            if is_alone and number == high:
                self._pay(agent, 1.0)
            elif is_alone and number == self.low:
                self._end(agent)

    def _look(self, agent: str) -> Any:
        return vector(self.low, self.tune)


CHAIRS = Form(
    name="chairs",
    api="parallel",
    stages=(("dancer",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"high": Part("dancer", "earner", "individual")},
    endings={"out": Ending("termination", "agent"), "time": TIME},
    symmetric={"dancer": True},
    horizon=15,
    influence=links(
        "dancer dancer reward 0", "dancer dancer ending 0", "dancer dancer observation 1"
    ),
    order_sensitive="none",
    advice="parallel",
)

FORMS = ((Podium, PODIUM), (Jury, JURY), (Hammer, HAMMER), (Pump, PUMP), (Chairs, CHAIRS))
