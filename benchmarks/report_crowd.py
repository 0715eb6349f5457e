"""How fast the player scrubs an episode of 300 agents in Chromium, as JSON lines.

Needs Playwright and Chromium (`make browser-test` sets both up):

    python benchmarks/report_crowd.py [--agents 300] [--turns 200]

The run is of random walkers on a plane; its report is written into a temporary folder. Figures are
those of `report_browser.py`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv
from playwright.sync_api import sync_playwright
from report_browser import ARGUMENTS, CHROMIUM, page_of, scrub, tell

import gamekeeper as gk

WIDTH: Final = 1440


class Walkers(ParallelEnv):
    """Agents that walk where they like, and are paid for going right."""

    metadata: dict[str, Any] = {"name": "walkers_v0"}  # noqa: RUF012  # PettingZoo's own form

    def __init__(self, agents: int, turns: int) -> None:
        """Names the agents."""
        self.possible_agents = [f"walker_{k}" for k in range(agents)]
        self.turns = turns
        spaces = Box(-1e3, 1e3, (2,), np.float32), Discrete(4)
        self.observation_spaces = dict.fromkeys(self.possible_agents, spaces[0])
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces[1])

    def observation_space(self, agent: str) -> Any:
        """A place."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """A direction."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws places."""
        rng = np.random.default_rng(seed)
        self.agents, self.count = list(self.possible_agents), 0
        self.places = rng.uniform(0, 40, (len(self.agents), 2)).astype(np.float32)
        return self._seen(), self._infos()

    def step(self, actions: dict[str, int]) -> Any:
        """Moves everybody."""
        agents, ways = self.agents, np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], np.float32)
        self.places += ways[[actions[agent] for agent in agents]]
        self.count += 1
        rewards = {agent: float(actions[agent] == 0) for agent in agents}
        answer = self._seen(), rewards, dict.fromkeys(agents, False)
        is_over = self.count >= self.turns
        self.agents = [] if is_over else agents
        return *answer, dict.fromkeys(agents, is_over), self._infos()

    def _seen(self) -> dict[str, Any]:
        return {agent: self.places[k].copy() for k, agent in enumerate(self.possible_agents)}

    def _infos(self) -> dict[str, Any]:
        places = self.places.tolist()
        return {agent: {"position": places[k]} for k, agent in enumerate(self.possible_agents)}


def main() -> None:
    """Writes the report, scrubs it, and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--agents", type=int, default=300)
    parser.add_argument("--turns", type=int, default=200)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        run = Path(folder) / "run"
        gk.rollout(lambda: Walkers(given.agents, given.turns), episodes=1, seed=0, out=run)
        page = gk.report(run, Path(folder) / "crowd.html")
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        opened = page_of(browser, page.as_uri(), WIDTH)
        tell("report_crowd", agents=given.agents, bytes=page.stat().st_size, **scrub(opened))
        browser.close()


if __name__ == "__main__":
    main()
