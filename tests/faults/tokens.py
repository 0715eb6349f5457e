"""A clean AEC environment with action masks that faulty ones inherit from: tokens on some cells.

Two players put tokens on free cells in turn; who fills a pair of neighbours first wins.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv

from tests.faults import clean

CELLS = 6


@clean()
class Tokens(AECEnv):
    """Players take free cells in turn; a pair of neighbours wins."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "tokens_v0",
        "render_modes": [],
        "is_parallelizable": False,
    }

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__()
        self.render_mode = render_mode
        self.possible_agents = ["player_0", "player_1"]
        self.agents: list[str] = []
        self._seen = {
            agent: spaces.Dict(
                {
                    "observation": spaces.Box(0, 2, (CELLS,), np.int8),
                    "action_mask": spaces.Box(0, 1, (CELLS,), np.int8),
                }
            )
            for agent in self.possible_agents
        }
        self._done = {agent: spaces.Discrete(CELLS) for agent in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """One cell is blocked; the first player is drawn."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {agent: {} for agent in self.agents}
        self._skip_agent_selection = None
        self.cells = np.zeros(CELLS, np.int8)
        self.blocked = int(self.rng.integers(CELLS))
        self.agent_selection = self.possible_agents[int(self.rng.integers(2))]

    def legal(self) -> Any:
        """Cells that may be taken, as int8."""
        free = self.cells == 0
        free[self.blocked] = False
        return free.astype(np.int8)

    def observe(self, agent: str) -> dict[str, Any]:
        """The cells as this player sees them: 1 its own, 2 the other's."""
        own = self.possible_agents.index(agent) + 1
        view = np.where(self.cells == 0, 0, np.where(self.cells == own, 1, 2)).astype(np.int8)
        is_next = agent == self.agent_selection and not self.terminations.get(agent, False)
        mask = self.legal() if is_next else np.zeros(CELLS, np.int8)
        return {"observation": view, "action_mask": mask}

    def step(self, action: Any) -> None:
        """One token."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        if not self.legal()[int(action)]:
            raise ValueError(f"cell {action} is taken")
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        own = self.possible_agents.index(agent) + 1
        self.cells[int(action)] = own
        other = self.possible_agents[2 - own]
        mine = self.cells == own
        if (mine[:-1] & mine[1:]).any():
            self.rewards[agent], self.rewards[other] = 1.0, -1.0
            self.terminations = dict.fromkeys(self.agents, True)
        elif not self.legal().any():
            self.terminations = dict.fromkeys(self.agents, True)
        self.agent_selection = other
        self._accumulate_rewards()

    def close(self) -> None:
        """Nothing is open."""
