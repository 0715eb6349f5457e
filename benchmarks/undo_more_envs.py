"""Three small environments without knobs for benchmarks/undo.py, with policies that do well.

Parallel with Box (two winches and a trolley), AEC with messages and MultiDiscrete (two scouts that
each say a digit, and an opener), Parallel with Discrete (three ants). Nothing is declared of them.
"""

from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import AgentSelector

DIGITS = 5
SIDE = 6
MOVES = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))
NEAR = 0.12


class Hoist(ParallelEnv):  # type: ignore[type-arg]  # as users write it
    """Winches lift a beam level to a height while a trolley rolls it over a mark."""

    metadata: ClassVar[dict[str, Any]] = {"name": "hoist_v0"}

    def __init__(self, max_cycles: int = 40, render_mode: str | None = None) -> None:
        """Opens it."""
        self.max_cycles, self.render_mode = max_cycles, render_mode
        self.possible_agents = ["winch_0", "winch_1", "trolley_0"]
        self.agents: list[str] = []
        seen, number = Box(-2, 2, (4,), np.float32), Box(-1, 1, (1,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = dict.fromkeys(self.possible_agents, number)
        self.action_spaces["trolley_0"] = Box(-1, 1, (2,), np.float32)

    def observation_space(self, agent: str) -> Any:
        """Its space."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Its space."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws heights, a goal, the place of the load and of its mark."""
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.heights, self.goal = self.rng.uniform(-1, -0.4, 2), self.rng.uniform(0.1, 0.9)
        while True:
            self.load, self.mark = self.rng.uniform(-1, 1, 2), self.rng.uniform(-1, 1, 2)
            if np.abs(self.load - self.mark).min() >= 0.5:
                break
        self.clock = self.steady = 0
        return self._seen(), {agent: {} for agent in self.agents}

    def _seen(self) -> dict[str, Any]:
        found: dict[str, Any] = {"trolley_0": [*self.load, *self.mark]}
        for k in (0, 1):
            found[f"winch_{k}"] = [self.heights[k], self.goal, self.heights[1 - k], self.steady / 4]
        return {agent: np.clip(row, -2, 2).astype(np.float32) for agent, row in found.items()}

    def step(self, actions: Any) -> Any:
        """All move at once; three ticks level and in place are enough."""
        self.clock += 1
        lifts = [float(actions[f"winch_{k}"][0]) for k in (0, 1)]
        self.heights = np.clip(self.heights + 0.1 * np.clip(lifts, -1, 1), -2, 2)
        rolls = np.clip(np.asarray(actions["trolley_0"], np.float64), -1, 1)
        self.load = np.clip(self.load + 0.1 * rolls, -2, 2)
        is_level = np.abs(self.heights - self.goal).max() < NEAR
        is_there = np.abs(self.load - self.mark).max() < NEAR
        self.steady = self.steady + 1 if is_level and is_there else 0
        is_done = self.steady >= 3
        is_late = not is_done and self.clock >= self.max_cycles
        agents = self.agents
        self.agents = [] if is_done or is_late else list(agents)
        return (
            self._seen(),
            dict.fromkeys(agents, float(is_done)),
            dict.fromkeys(agents, is_done),
            dict.fromkeys(agents, is_late),
            {agent: {} for agent in agents},
        )


def hoist(observation: Any, agent: str) -> Any:
    """Steers in proportion to what is missing."""
    if agent.startswith("winch"):
        missing = observation[1:2] - observation[0:1]
    else:
        missing = observation[2:4] - observation[0:2]
    return np.clip(4 * missing, -1, 1).astype(np.float32)


class Safe(AECEnv):  # type: ignore[type-arg]  # as users write it
    """Each scout sees a digit of the code and says one; the opener dials two and pulls."""

    metadata: ClassVar[dict[str, Any]] = {"name": "safe_v0", "is_parallelizable": True}

    def __init__(self, rounds: int = 8, render_mode: str | None = None) -> None:
        """Opens it."""
        super().__init__()
        self.rounds, self.render_mode = rounds, render_mode
        self.possible_agents = ["scout_0", "scout_1", "opener_0"]
        seen, word = MultiDiscrete([DIGITS, 2, DIGITS, 2, 4]), MultiDiscrete([DIGITS, 2])
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = dict.fromkeys(self.possible_agents, word)
        self.action_spaces["opener_0"] = MultiDiscrete([DIGITS, DIGITS, 2])

    def observation_space(self, agent: str) -> Any:
        """Its space."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Its space."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Draws two different digits; nothing was said."""
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self.code = self.rng.choice(DIGITS, 2, replace=False).tolist()
        self.said, self.strikes, self.round = [[0, 0], [0, 0]], 0, 0
        self._order = AgentSelector(self.agents)
        self.agent_selection = self._order.next()

    def observe(self, agent: str) -> Any:
        """What both scouts said; of a scout its own digit, and what the other said."""
        if agent == "opener_0":
            row = [*self.said[0], *self.said[1], self.strikes]
        else:
            own = int(agent[-1])
            row = [self.code[own], 1, *self.said[1 - own], self.strikes]
        return np.array(row, np.int64)

    def step(self, action: Any) -> None:
        """A word, or a pull: three wrong ones end it."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self.rewards = dict.fromkeys(self.agents, 0.0)
        row = [int(each) for each in action]
        if agent == "opener_0":
            self._pull(row[:2], is_pulled=bool(row[2]))
        else:
            self.said[int(agent[-1])] = row
        self._accumulate_rewards()
        self.agent_selection = self._order.next()

    def _pull(self, dial: list[int], *, is_pulled: bool) -> None:
        self.round += 1
        is_open = is_pulled and dial == self.code
        self.strikes += is_pulled and not is_open
        if is_open:
            self.rewards = dict.fromkeys(self.agents, 1.0)
        if is_open or self.strikes == 3:
            self.terminations = dict.fromkeys(self.agents, True)
        elif self.round >= self.rounds:
            self.truncations = dict.fromkeys(self.agents, True)


def safe(observation: Any, agent: str) -> Any:
    """Says its digit; dials what was said, and pulls once both have spoken."""
    first, ready, second, also = (int(each) for each in observation[:4])
    if agent == "opener_0":
        return np.array([first, second, int(ready and also)], np.int64)
    return np.array([first, 1], np.int64)


class Ants(ParallelEnv):  # type: ignore[type-arg]  # as users write it
    """Each ant fetches its crumb and brings it to the nest, where it is done."""

    metadata: ClassVar[dict[str, Any]] = {"name": "ants_v0"}

    def __init__(self, episode_limit: int = 40, render_mode: str | None = None) -> None:
        """Opens it."""
        self.episode_limit, self.render_mode = episode_limit, render_mode
        self.possible_agents = ["ant_0", "ant_1", "ant_2"]
        self.agents: list[str] = []
        self.seen, self.acts = Box(0, SIDE - 1, (7,), np.int64), Discrete(6)

    def observation_space(self, agent: str) -> Any:
        """Its space."""
        return self.seen

    def action_space(self, agent: str) -> Any:
        """Its space."""
        return self.acts

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws seven cells."""
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        cells = self.rng.permutation(SIDE * SIDE)[:7].tolist()
        spots = [[cell // SIDE, cell % SIDE] for cell in cells]
        self.places = dict(zip(self.agents, spots[:3], strict=True))
        self.crumbs = dict(zip(self.agents, spots[3:6], strict=True))
        self.nest, self.clock = spots[6], 0
        self.carries = dict.fromkeys(self.agents, 0)
        return self._seen(self.agents), {agent: {} for agent in self.agents}

    def _seen(self, agents: list[str]) -> dict[str, Any]:
        rows = {a: [*self.places[a], *self.crumbs[a], *self.nest, self.carries[a]] for a in agents}
        return {agent: np.array(row, np.int64) for agent, row in rows.items()}

    def step(self, actions: Any) -> Any:
        """Each moves by itself; walls hold it, and 5 picks up."""
        self.clock += 1
        now = list(self.agents)
        for agent in now:
            self._move(agent, int(actions[agent]))
        home = {a: bool(self.carries[a]) and self.places[a] == self.nest for a in now}
        is_late = self.clock >= self.episode_limit
        self.agents = [agent for agent in now if not home[agent] and not is_late]
        return (
            self._seen(now),
            {agent: float(home[agent]) for agent in now},
            home,
            {agent: is_late and not home[agent] for agent in now},
            {agent: {} for agent in now},
        )

    def _move(self, agent: str, action: int) -> None:
        if action == 5:
            self.carries[agent] |= int(self.places[agent] == self.crumbs[agent])
            return
        cell = [a + d for a, d in zip(self.places[agent], MOVES[action], strict=True)]
        if min(cell) >= 0 and max(cell) < SIDE:
            self.places[agent] = cell
        if self.carries[agent]:
            self.crumbs[agent] = list(self.places[agent])


def ants(observation: Any, agent: str) -> int:
    """Walks to the crumb, picks it up, walks to the nest."""
    place, crumb, nest, carries = np.split(np.asarray(observation), [2, 4, 6])
    across, up = (nest if carries[0] else crumb) - place
    if not carries[0] and not across and not up:
        return 5
    if across:
        return 3 if across > 0 else 4
    return 0 if not up else 1 if up > 0 else 2
