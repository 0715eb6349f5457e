"""An environment that raises where a closed door is chosen; masks are in infos."""

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

ALLOWED = np.array([0, 1, 1], np.int8)


class Doors(ParallelEnv):
    """Two agents at three doors, of which the first is closed."""

    metadata = {"name": "doors_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way
    render_mode = None

    def __init__(self) -> None:
        self.possible_agents = ["left", "right"]

    def observation_space(self, agent: str) -> Any:
        """A clock."""
        return SEEN

    def action_space(self, agent: str) -> Any:
        """A door."""
        return DOORS

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Both are there."""
        self.agents, self.time = self.possible_agents[:], 0
        return self._seen(), self._infos()

    def step(self, actions: Any) -> Any:
        """Raises for a closed door; six ticks are an episode."""
        if 0 in [int(action) for action in actions.values()]:
            raise LookupError("the door is locked")
        self.time += 1
        seen, infos, here = self._seen(), self._infos(), self.agents
        if self.time == 6:
            self.agents = []
        ends = dict.fromkeys(here, self.time == 6)
        return seen, dict.fromkeys(here, 1.0), ends, dict.fromkeys(here, False), infos

    def _seen(self) -> Any:
        return {agent: np.full(1, self.time, np.float32) for agent in self.agents}

    def _infos(self) -> Any:
        return {agent: {"action_mask": ALLOWED.copy()} for agent in self.agents}


SEEN = spaces.Box(0, 6, (1,), np.float32)
DOORS = spaces.Discrete(3)
SPEC = f"{__file__}:Doors"
SAYS = r"(?s)'right' did what is masked out.*one of \[1, 2\].*the door is locked.*fix: .*mask"
"""Text of every adapter's error where 'right' chooses the closed door."""
