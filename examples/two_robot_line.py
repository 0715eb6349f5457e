"""Two robots on a line meet: the smallest task that Gamekeeper can record, replay and judge.

Rules:
    1. The line has five cells, 0 to 4. `picker` starts in cell 0, `carrier` in cell 4.
    2. Each tick both move at once: action 0 one cell down, 1 nowhere, 2 one cell up. A robot at
       the end of the line that moves outwards stays where it is.
    3. Robots that stand in one cell after a tick have met: each is paid 1.0 and terminated.
    4. There is no time limit. Robots that swap cells pass each other and haven't met.

Source: the textbook exercise of two robots on a line (fragment 10.7.1), written anew with
observations that lie in their spaces.
"""

from __future__ import annotations

from typing import Any, ClassVar, Final

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

CELLS: Final = 5
STARTS: Final = {"picker": 0, "carrier": CELLS - 1}
MEETING: Final = 1.0
"""Reward of each robot when they meet."""


class TwoRobotLine(ParallelEnv[str, np.ndarray, int]):
    """Each robot sees its own cell, [1] int64 in 0 to 4.

    Args:
        render_mode: `ansi` (render gives the line as text) or None.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "two_robot_line_v0",
        "render_modes": ["ansi"],
        "is_parallelizable": True,
    }

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.possible_agents = list(STARTS)
        self.observation_spaces = {
            agent: spaces.Box(0, CELLS - 1, (1,), np.int64) for agent in STARTS
        }
        self.action_spaces = {agent: spaces.Discrete(3) for agent in STARTS}
        self.agents: list[str] = []
        self.cells: dict[str, int] = {}

    def observation_space(self, agent: str) -> spaces.Box:
        """The agent's own cell."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete:
        """Down, nowhere, up."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, int]]]:
        """Puts the robots at the two ends; nothing is random, so the seed changes nothing."""
        self.agents = list(self.possible_agents)
        self.cells = dict(STARTS)
        return self._observations(), self._infos()

    def step(self, actions: dict[str, int]) -> tuple[dict[str, Any], ...]:
        """Moves both robots, then looks whether they met."""
        live = self.agents
        for agent in live:
            moved = self.cells[agent] + int(actions[agent]) - 1
            self.cells[agent] = min(max(moved, 0), CELLS - 1)
        met = len(set(self.cells.values())) == 1
        result = (
            self._observations(),
            dict.fromkeys(live, MEETING if met else 0.0),
            dict.fromkeys(live, met),
            dict.fromkeys(live, False),
            self._infos(),
        )
        if met:
            self.agents = []
        return result

    def render(self) -> str | None:
        """The line as text, as `p..c.`; a star where both robots stand."""
        if self.render_mode is None:
            return None
        line = ["."] * CELLS
        for agent, cell in self.cells.items():
            line[cell] = agent[0] if line[cell] == "." else "*"
        return "".join(line)

    def _observations(self) -> dict[str, np.ndarray]:
        return {agent: np.array([self.cells[agent]], dtype=np.int64) for agent in self.agents}

    def _infos(self) -> dict[str, dict[str, int]]:
        return {agent: {"position": self.cells[agent]} for agent in self.agents}


def make(render_mode: str | None = None) -> TwoRobotLine:
    """A new line with both robots; the factory that `two_robot_line.py:make` names."""
    return TwoRobotLine(render_mode=render_mode)
