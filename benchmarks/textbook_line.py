"""Two robots on a line as a textbook prints it: plain dictionaries, no base class of ours.

What a tick costs here is next to nothing, so what stands around it is seen. Source: the textbook's
two robots on a line; observations are arrays, as their space says.
"""

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

LAST = 4


class TextbookLine(ParallelEnv):
    """Both move at once; who stand in one cell are paid 1, and it ends."""

    metadata = {"name": "textbook_line_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self) -> None:
        self.possible_agents = ["picker", "carrier"]
        self.render_mode = None
        self.observation_spaces = dict.fromkeys(self.possible_agents, Box(0, LAST, (1,), np.int64))
        self.action_spaces = {agent: Discrete(3) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Any:
        """Its cell."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Down, nowhere, up."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Both at their ends."""
        self.agents = self.possible_agents[:]
        self.cells = {"picker": 0, "carrier": LAST}
        return self._seen(), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """One tick."""
        for agent, action in actions.items():
            self.cells[agent] = min(LAST, max(0, self.cells[agent] + int(action) - 1))
        have_met = self.cells["picker"] == self.cells["carrier"]
        agents = self.agents
        given = (
            self._seen(),
            dict.fromkeys(agents, float(have_met)),
            dict.fromkeys(agents, have_met),
            dict.fromkeys(agents, False),
            {agent: {"position": self.cells[agent]} for agent in agents},
        )
        if have_met:
            self.agents = []
        return given

    def _seen(self) -> dict[str, Any]:
        return {agent: np.array([cell], np.int64) for agent, cell in self.cells.items()}


def parallel_env() -> TextbookLine:
    """As PettingZoo's modules offer it."""
    return TextbookLine()
