"""Order races within a tick: how many an audit finds, beside random play of the same budget.

    python benchmarks/order_races.py [--budget 2000] [--seeds 3]

Eight environments in which the first of the action dictionary wins one thing that is rarely
competed for, and eight sound ones in which nothing hangs on the order. The probe of the order looks
at each with the policies that bring agents together, and with random ones alone. Printed: how often
each race was seen, the mean steps of a look, and sound environments that were accused.
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

from gamekeeper.auditing.gather import gather, session_of
from gamekeeper.auditing.probes import dictionary_order
from gamekeeper.checks.facts.episode_facts import OrderOutcome
from gamekeeper.interface.opening import open_env

MOVES = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))
LIMIT = 100


class Field(ParallelEnv):
    """Agents on a grid; a rule settles what they do in a tick, by an order of names."""

    metadata = {"name": "field_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it
    count, size, actions = 3, (10, 10), len(MOVES)

    def __init__(self, *, sound: bool = False) -> None:
        self.sound, self.render_mode = sound, None
        self.possible_agents = [f"agent_{k}" for k in range(self.count)]
        self.agents: list[str] = []
        high = float(max(*self.size, LIMIT))
        self._seen = {a: Box(-high, high, (4,), np.float32) for a in self.possible_agents}
        self._done = {a: Discrete(self.actions) for a in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> Any:
        """Own cell, and the thing's."""
        return self._seen[agent]

    def action_space(self, agent: str) -> Any:
        """Moves, and what the rule adds."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Places agents and the thing."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents, self.time = self.possible_agents[:], 0
        cells = self.rng.permutation(self.size[0] * self.size[1])[: self.count + 1]
        places = [divmod(int(cell), self.size[1]) for cell in cells]
        self.places = dict(zip(self.agents, places, strict=False))
        self.thing = self.middle() or places[-1]
        return {a: self.observation(a) for a in self.agents}, {a: {} for a in self.agents}

    def middle(self) -> tuple[int, int] | None:
        """A fixed place of the thing."""
        return None

    def observation(self, agent: str) -> Any:
        """Own cell, and the thing's."""
        return np.array([*self.places[agent], *self.thing], np.float32)

    def moved(self, agent: str, action: int) -> tuple[int, int]:
        """The cell that a move leads to."""
        step = MOVES[action] if action < len(MOVES) else (0, 0)
        rows, columns = self.size
        row, column = self.places[agent]
        return min(max(row + step[0], 0), rows - 1), min(max(column + step[1], 0), columns - 1)

    def step(self, actions: Any) -> Any:
        """Moves all, and settles who is paid."""
        self.time += 1
        acting, rewards = self.agents, dict.fromkeys(self.agents, 0.0)
        done = {a: int(actions[a]) for a in (self.agents if self.sound else actions)}
        for winner in self.settled(done):
            rewards[winner] += 1.0
        over = self.time >= LIMIT
        out = {a: self.observation(a) for a in acting}
        self.agents = [] if over else acting
        flags = dict.fromkeys(acting, False), dict.fromkeys(acting, over)
        return out, rewards, *flags, {a: {} for a in acting}

    def settled(self, done: dict[str, int]) -> list[str]:
        """Agents that win something; `done` stands in the order in which they come."""
        self.places = {a: self.moved(a, action) for a, action in done.items()}
        return [a for a in done if self.wants(a, done[a])][:1]

    def wants(self, agent: str, action: int) -> bool:
        """Tells whether an agent asks for the thing in this tick."""
        return False


class Item(Field):
    """The first on the item's cell takes it."""

    def wants(self, agent: str, action: int) -> bool:
        """On its cell."""
        return self.places[agent] == self.thing


class Charger(Field):
    """The first who waits on a fixed charger in the middle is charged; it isn't observed."""

    def middle(self) -> tuple[int, int] | None:
        """The middle."""
        return self.size[0] // 2, self.size[1] // 2

    def observation(self, agent: str) -> Any:
        """Own cell, and nothing of the charger."""
        return np.array([*self.places[agent], 0, 0], np.float32)

    def wants(self, agent: str, action: int) -> bool:
        """Waiting on its cell."""
        return action == 0 and self.places[agent] == self.thing


class Cell(Field):
    """A free cell is entered by the first that wants it."""

    size = (12, 12)

    def settled(self, done: dict[str, int]) -> list[str]:
        """By snapshot where it is sound: two that want one cell stay."""
        wanted = {a: self.moved(a, action) for a, action in done.items()}
        before = dict(self.places)
        for agent, cell in wanted.items():
            taken = before if self.sound else self.places
            others = [taken[b] for b in done if b != agent]
            is_wanted = self.sound and [*wanted.values()].count(cell) > 1
            if cell not in others and not is_wanted:
                self.places[agent] = cell
        return []


class Door(Field):
    """One a tick passes a door at the row's end: the first that pushes."""

    size, actions, count = (6, 12), 6, 2

    def middle(self) -> tuple[int, int] | None:
        """The door."""
        return 0, 11

    def wants(self, agent: str, action: int) -> bool:
        """Pushing in front of it."""
        return action == 5 and self.places[agent] == self.thing


class Coin(Field):
    """Two on a row of thirty cells, and one coin."""

    size, count = (1, 30), 2

    def wants(self, agent: str, action: int) -> bool:
        """On its cell."""
        return self.places[agent] == self.thing


class Auction(Field):
    """The highest of thirty bids wins; of equal ones above twenty the first."""

    actions, count = 30, 2

    def settled(self, done: dict[str, int]) -> list[str]:
        """The highest bidder."""
        best = max(done.values())
        return [a for a in done if done[a] == best and best >= 24][:1]


class Bandwidth(Field):
    """A channel carries two messages a tick; a third of the four is lost, the last."""

    actions, count = 12, 4

    def settled(self, done: dict[str, int]) -> list[str]:
        """Senders on channel 7 that fit."""
        return [a for a in done if done[a] == 7][:2]


class Corner(Field):
    """In one corner of a large field the first one digs."""

    size, actions, count = (16, 16), 6, 4

    def wants(self, agent: str, action: int) -> bool:
        """Digging in the corner."""
        return action == 5 and sum(self.places[agent]) <= 1


KINDS = (Item, Charger, Cell, Door, Coin, Auction, Bandwidth, Corner)


def looked(kind: type[Field], *, sound: bool, budget: int, seed: int) -> tuple[bool, int]:
    """Whether the probe saw the order matter, and the steps that it took until then."""
    opened = open_env(partial(kind, sound=sound))
    session = session_of(opened, None, spec=kind, kwargs={}, seed=seed, budget=budget)
    gathering = gather(session, {"order"}, died={}, on_probe=lambda *at: None)
    results = [fact.value.result for fact in gathering.gathered().facts(OrderOutcome)]
    return bool({"outcome", "draws", "undecided"} & set(results)), session.meter.steps


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--budget", type=int, default=2_000, help="steps of the probe")
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    budget, seeds = options.budget, options.seeds
    meetings = dictionary_order.MEETINGS
    print(f"budget {budget} steps of the probe, {seeds} seeds")
    print(f"{'race':<12}{'meeting':>9}{'random':>8}{'steps':>7}{'sound accused':>15}", flush=True)
    sums = np.zeros(3, int)
    for kind in KINDS:
        found = []
        for every in (meetings, 1):
            dictionary_order.MEETINGS = every
            runs = [looked(kind, sound=False, budget=budget, seed=k) for k in range(seeds)]
            found.append((sum(each for each, _ in runs), sum(steps for _, steps in runs) // seeds))
        dictionary_order.MEETINGS = meetings
        accused = [looked(kind, sound=True, budget=budget, seed=k)[0] for k in range(seeds)]
        row = found[0][0], found[1][0], sum(accused)
        sums += row
        name = kind.__name__.lower()
        print(f"{name:<12}{row[0]:>9}{row[1]:>8}{found[0][1]:>7}{row[2]:>15}", flush=True)
    print(f"{'of ' + str(len(KINDS) * seeds):<12}{sums[0]:>9}{sums[1]:>8}{'':>7}{sums[2]:>15}")


if __name__ == "__main__":
    main()
