"""An environment whose guests, and what they see, differ from episode to episode."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from pathlib import Path
from typing import ClassVar

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv


class Crowd(ParallelEnv):
    """A host plays four ticks; a guest that nobody announced joins it after the first.

    The seed of the reset says which guest it is; guests of one size see alike.

    Args:
        fails: seeds of resets whose episodes raise at their third tick.
        kills: a file; the first episode that doesn't find it writes it and ends its process.
        dies: seeds of resets whose episodes end their process at their third tick.
        waits: a file; as long as it names the seed of a reset, that episode waits.
        leaks: ticks of earlier episodes are in what the host is paid.
    """

    metadata: ClassVar = {
        "name": "crowd_v0",
        "is_parallelizable": True,
        "render_modes": ["rgb_array"],
    }

    def __init__(self, fails=(), kills="", dies=(), waits="", leaks=False, render_mode=None):
        self.leaks, self.before = leaks, 0
        self.fails, self.kills, self.dies, self.waits = fails, kills, dies, waits
        self.render_mode = render_mode
        self.possible_agents = ["host"]
        self.agents = []

    def observation_space(self, agent):
        size = 2 if agent == "host" else 3 + int(agent.split("_")[1]) % 3
        return spaces.Box(-9, 9, (size,), np.float64)

    def action_space(self, agent):
        return spaces.Discrete(3)

    def reset(self, seed=None, options=None):
        self.seed, self.rng = seed, np.random.default_rng(seed)
        self.guest = f"guest_{int(self.rng.integers(0, 7))}"
        self.agents, self.tick = ["host"], 0
        return self.see(), {"host": {"start": (options or {}).get("start", 0)}}

    def see(self):
        return {
            agent: self.rng.uniform(-1, 1, self.observation_space(agent).shape)
            for agent in self.agents
        }

    def state(self):
        return np.array([self.tick, len(self.agents)], np.int64)

    def render(self):
        return np.full((4, 4, 3), 10 * self.tick, np.uint8)

    def step(self, actions):
        self.tick += 1
        if self.tick == 3:
            self.go_wrong()
        while self.waits and str(self.seed) in Path(self.waits).read_text():
            time.sleep(0.01)
        agents = ["host", self.guest] if self.tick >= 1 else ["host"]
        self.agents, ended = agents, self.tick >= 4
        seen = self.see()
        if ended:
            self.agents = []
        rewards = {agent: float(actions.get(agent, 0)) for agent in agents}
        rewards["host"] += self.before
        self.before += int(self.leaks and ended)
        infos = {agent: {"tick": self.tick} for agent in agents}
        flags = dict.fromkeys(agents, ended), dict.fromkeys(agents, False)
        return seen, rewards, *flags, infos

    def go_wrong(self):
        if self.seed in self.fails:
            raise RuntimeError("the crowd is stuck")
        if self.kills:
            with contextlib.suppress(FileExistsError):
                Path(self.kills).touch(exist_ok=False)  # at once: of two workers one is first
                os.kill(os.getpid(), signal.SIGKILL)
        if self.seed in self.dies:
            time.sleep(0.3)  # so that what was played reaches the disk
            os._exit(5)
