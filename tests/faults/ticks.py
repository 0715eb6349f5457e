"""What decides within a tick: who acts first, who sees the others' choice."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

from tests.faults import clean, faulty
from tests.faults.rovers import Rovers

HANDS_CONTRACT = {
    "api": "aec",
    "schedule": {"stages": [["player"]], "order": "none", "observe": "after tick"},
}
SIZE = 5
TURNS = ((0, 1), (1, 0), (0, -1), (-1, 0))
STAY, AHEAD, LEFT, RIGHT, FIRE = range(5)
REACH = 4


@faulty("GK311")
class Beams(ParallelEnv):
    """Beams fire in the order of the action dictionary: an agent hit first doesn't fire any more.

    Source: Sequential Social Dilemma Games, Cleanup and Harvest, whose `update_custom_moves` goes
    through the dictionary that the caller handed over; rebuilt small.

    Gardeners walk over a torus, eat apples, and stun each other with beams.
    """

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "beams_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

    def __init__(self, count: int = 6, horizon: int = 50, render_mode: str | None = None) -> None:
        self.count, self.horizon, self.render_mode = count, horizon, render_mode
        self.possible_agents = [f"gardener_{i}" for i in range(count)]
        self.agents: list[str] = []
        size = 4 * count + SIZE * SIZE
        self._seen = {a: spaces.Box(-1, SIZE, (size,), np.float32) for a in self.possible_agents}
        self._done = {a: spaces.Discrete(5) for a in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Places gardeners and apples."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.time = 0
        self.cells = {a: tuple(self.rng.integers(SIZE, size=2).tolist()) for a in self.agents}
        self.facing = {a: int(self.rng.integers(4)) for a in self.agents}
        self.stunned = dict.fromkeys(self.agents, 0)
        self.apples = self.rng.random((SIZE, SIZE)) < 0.2
        return {a: self.observation(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """All walk, then the beams: here the order of the dictionary decides."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        self.time += 1
        rewards = dict.fromkeys(self.agents, 0.0)
        able = {a: self.stunned[a] == 0 for a in self.agents}
        self.stunned = {a: max(n - 1, 0) for a, n in self.stunned.items()}
        for agent in self.agents:
            if able[agent]:
                self.walk(agent, int(actions[agent]))
                rewards[agent] += self.eat(agent)
        for agent in self.firing_order(actions):
            if able[agent] and int(actions[agent]) == FIRE and not self.stunned[agent]:
                for other in self.hit_by(agent):
                    self.stunned[other] = 3
                    rewards[other] -= 1.0
        self.apples |= self.rng.random((SIZE, SIZE)) < 0.02
        over = self.time >= self.horizon
        acting, self.agents = self.agents, [] if over else self.agents
        ended = dict.fromkeys(acting, False), dict.fromkeys(acting, over)
        seen = {a: self.observation(a) for a in acting}
        return seen, rewards, *ended, {a: {} for a in acting}

    def firing_order(self, actions: dict[str, Any]) -> list[str]:
        """Who fires before whom."""
        return list(actions)

    def walk(self, agent: str, action: int) -> None:
        """A step ahead, or a turn."""
        if action in (LEFT, RIGHT):
            self.facing[agent] = (self.facing[agent] + (1 if action == RIGHT else -1)) % 4
        elif action == AHEAD:
            (row, column), (down, right) = self.cells[agent], TURNS[self.facing[agent]]
            self.cells[agent] = ((row + down) % SIZE, (column + right) % SIZE)

    def eat(self, agent: str) -> float:
        """1 for an apple on the gardener's cell."""
        is_there = bool(self.apples[self.cells[agent]])
        self.apples[self.cells[agent]] = False
        return float(is_there)

    def hit_by(self, agent: str) -> list[str]:
        """Who stands in the beam."""
        (row, column), (down, right) = self.cells[agent], TURNS[self.facing[agent]]
        beam = {((row + k * down) % SIZE, (column + k * right) % SIZE) for k in range(1, REACH + 1)}
        return [a for a in self.agents if a != agent and self.cells[a] in beam]

    def observation(self, agent: str) -> Any:
        """The own row first, then those of all, and the apples."""
        rows = [
            [*self.cells[a], self.facing[a], self.stunned[a]]
            for a in sorted(self.possible_agents, key=lambda a: a != agent)
        ]
        return np.concatenate([np.ravel(rows), self.apples.ravel()]).astype(np.float32)

    def close(self) -> None:
        """Nothing is open."""


@faulty("GK312")
class DrawsByDictionary(Rovers):
    """The wind is drawn in the order of the action dictionary.

    Who stands first in the dictionary is driven first, and gets the first draw.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Drives in the order of the dictionary."""
        self.order = list(actions)
        self.waiting = dict(actions)
        return super().step(actions)

    def drive(self, agent: str, action: int) -> None:
        """The draw is that of the agent in the same place of the dictionary."""
        first = self.order.pop(0)
        super().drive(first, int(self.waiting[first]))


HANDS = 3


@faulty("GK331", contract=HANDS_CONTRACT)
class Hands(AECEnv):
    """Hands that are shown at once, played in turns: the last player sees those before it.

    All show a hand; who shows one that nobody else does is paid its number.
    """

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "hands_v0",
        "render_modes": [],
        "is_parallelizable": False,
    }

    def __init__(self, count: int = 3, rounds: int = 12, render_mode: str | None = None) -> None:
        super().__init__()
        self.count, self.rounds, self.render_mode = count, rounds, render_mode
        self.possible_agents = [f"player_{i}" for i in range(count)]
        self.agents: list[str] = []
        size = count + 1
        self._seen = {
            a: spaces.Box(0, max(HANDS, rounds), (size,), np.float32) for a in self.possible_agents
        }
        self._done = {a: spaces.Discrete(HANDS) for a in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """No hands are shown; nothing is drawn."""
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {a: {} for a in self.agents}
        self._skip_agent_selection = None
        self.shown = dict.fromkeys(self.agents, HANDS)
        self.chosen: dict[str, int] = {}
        self.time = 0
        self.agent_selection = self.agents[0]

    def observe(self, agent: str) -> Any:
        """The hands of all, the own one first, and the time."""
        names = sorted(self.possible_agents, key=lambda a: a != agent)
        return np.array([*(self.visible(a) for a in names), self.time], np.float32)

    def visible(self, agent: str) -> int:
        """The hand that others see: here the one of this very tick."""
        return self.chosen.get(agent, self.shown[agent])

    def step(self, action: Any) -> None:
        """One hand; after the last all are shown and paid."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.chosen[agent] = int(action)
        if len(self.chosen) == self.count:
            self.settle()
        place = self.possible_agents.index(agent)
        self.agent_selection = self.possible_agents[(place + 1) % self.count]
        self._accumulate_rewards()

    def settle(self) -> None:
        """Pays hands that stand alone."""
        self.shown, self.chosen = self.chosen, {}
        self.time += 1
        hands = list(self.shown.values())
        self.rewards = {
            a: float(hand) if hands.count(hand) == 1 else 0.0 for a, hand in self.shown.items()
        }
        if self.time >= self.rounds:
            self.truncations = dict.fromkeys(self.agents, True)

    def close(self) -> None:
        """Nothing is open."""


@clean()
class FairBeams(Beams):
    """A clean environment: beams of one tick all fire, whoever is hit.

    Who is hit in a tick is stunned from the next one on.
    """

    late: dict[str, int]

    def firing_order(self, actions: dict[str, Any]) -> list[str]:
        """The environment's own; it makes no difference here."""
        return list(self.agents)

    def hit_by(self, agent: str) -> list[str]:
        """Stuns after the tick: who fires isn't stopped by who fired before."""
        hit = super().hit_by(agent)
        self.late |= dict.fromkeys(hit, 3)
        return []

    def step(self, actions: dict[str, Any]) -> Any:
        """The beams' effects come once all have fired."""
        self.late = {}
        out = super().step(actions)
        for agent, ticks in self.late.items():
            self.stunned[agent] = ticks
            out[1][agent] -= 1.0
        return ({a: self.observation(a) for a in out[0]}, *out[1:])


@clean(contract={**HANDS_CONTRACT, "roles": {"player": {"symmetric": True}}})
class HiddenHands(Hands):
    """A clean environment: a simultaneous game in turns, whose hands show once all have chosen.

    Hands of the tick stay hidden until it is over.
    """

    def visible(self, agent: str) -> int:
        """The hand of the last tick."""
        return self.shown[agent]
