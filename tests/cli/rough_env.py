"""A Parallel environment that can go wrong in every way that a command has to survive."""

import ctypes
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

print("printed on import")  # noqa: T201  # the noise that stdout is kept clean of


class PanicError(BaseException):
    """As Python sees a panic of code in Rust: no Exception."""


class RoughEnv(ParallelEnv):
    """Two agents are paid 1.0 a tick until `length` ticks are over.

    Args:
        length: ticks of an episode.
        how: what goes wrong: `raise`, `hang`, `exit` (sys.exit), `die` (os._exit), `segfault`,
            `panic` (no Exception, as of Rust), `interrupt`, `init` (while it is built), or nothing.
        after: a folder; it goes wrong at the first tick that finds recorded rows there.
        tick_s: how long a tick takes, in seconds.
        is_loud: it prints to stdout in three ways.
        drift: added to every observation; another value is another environment.
    """

    metadata = {"name": "rough_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo's do

    def __init__(
        self,
        length: int = 6,
        how: str = "",
        after: str = "",
        tick_s: float = 0.0,
        is_loud: bool = False,
        drift: float = 0.0,
    ) -> None:
        if how == "init":
            raise ValueError("no gripper is fitted")
        self.length, self.how, self.after, self.tick_s = length, how, after, tick_s
        self.is_loud = is_loud
        self.drift = float(os.environ.get("ROUGH_DRIFT", drift))
        self.possible_agents = ["arm", "leg"]
        self.agents: list[str] = []
        self.tick = 0

    def observation_space(self, agent: str) -> spaces.Box:
        return spaces.Box(-1e6, 1e6, (2,), np.float64)

    def action_space(self, agent: str) -> spaces.Discrete:
        return spaces.Discrete(3)

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        self.agents = list(self.possible_agents)
        self.tick = 0
        return self._observations(), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> tuple[Any, ...]:
        self.tick += 1
        if self.is_loud:
            self._make_noise()
        if self.tick_s:
            time.sleep(self.tick_s)
        if self.how and has_turns(self.after):
            self._go_wrong()
        is_over = self.tick >= self.length
        live, seen = self.agents, self._observations()
        self.agents = [] if is_over else live
        return (
            seen,
            dict.fromkeys(live, 1.0),
            dict.fromkeys(live, is_over),
            dict.fromkeys(live, False),
            {agent: {} for agent in live},
        )

    def _observations(self) -> Any:
        return {agent: np.array([self.tick, self.drift], np.float64) for agent in self.agents}

    def _make_noise(self) -> None:
        print("print of the environment")  # noqa: T201  # the same
        os.write(1, b"bytes of the environment\n")
        os.system("echo a program of the environment")

    def _go_wrong(self) -> None:
        if self.how == "raise":
            raise RuntimeError("the gripper is stuck")
        if self.how == "panic":
            raise PanicError("unreachable grip")
        if self.how == "interrupt":
            raise KeyboardInterrupt
        if self.how == "hang":
            time.sleep(1000)
        if self.how == "exit":
            sys.exit(4)
        if self.how == "die":
            os._exit(3)
        if self.how == "segfault":
            ctypes.string_at(0)


def has_turns(run: str | Path) -> bool:
    """Whether turns of a run lie on the disk; the time of a turn is what is written last."""
    return any(path.stat().st_size for path in Path(run).glob("timings-*"))


def make(**settings: Any) -> RoughEnv:
    """A new rough environment."""
    return RoughEnv(**settings)


def nothing(observation: Any, agent: Any, info: Any, rng: Any) -> None:
    """A policy that forgets to answer."""


def ones(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """A policy that always does 1."""
    return 1
