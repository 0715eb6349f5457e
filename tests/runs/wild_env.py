"""Environments that misbehave in one chosen place and one chosen way, in both APIs."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

HELD: Final[list[Any]] = []
"""What leaks: nobody ever takes it out again."""


def _leak() -> None:
    while True:
        HELD.append(np.ones(1 << 21))  # 16 MB that are written to


def _fork() -> None:
    if os.fork() == 0:  # the child goes on as if it were the environment
        time.sleep(0.2)


def _start_program() -> None:
    HELD.append(subprocess.Popen(["sleep", "60"]))


def _start_thread() -> None:
    thread = threading.Thread(target=time.sleep, args=(60,))  # no daemon: exit waits for it
    thread.start()


def _close_descriptors() -> None:
    for number in range(3, 64):
        try:
            os.close(number)
        except OSError:
            continue


def _print() -> None:
    print("wild print")  # noqa: T201  # the noise that stdout is kept clean of
    os.write(1, b"wild bytes\n")
    os.write(2, b"wild error\n")


def _handle_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1):
        signal.signal(number, signal.SIG_IGN)


def _raise() -> None:
    raise RuntimeError("wild error")


def _raise_base() -> None:
    raise GeneratorExit("wild base")


def _recurse() -> None:
    _recurse()


def _hang() -> None:
    time.sleep(1000)


def _spin() -> None:
    while True:
        pass


def _meddle() -> None:
    for meddle in ("thread", "program", "fork", "signals", "chdir", "delete"):
        WAYS[meddle]()


WAYS: Final[dict[str, Callable[[], Any]]] = {
    "raise": _raise,
    "base": _raise_base,
    "recurse": _recurse,
    "hang": _hang,
    "spin": _spin,
    "exit": lambda: sys.exit(3),
    "exit0": lambda: sys.exit(0),
    "_exit": lambda: os._exit(3),
    "_exit0": lambda: os._exit(0),
    "segfault": lambda: ctypes.string_at(0),
    "abort": os.abort,
    "kill": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "leak": _leak,
    "print": _print,
    "fork": _fork,
    "program": _start_program,
    "thread": _start_thread,
    "signals": _handle_signals,
    "chdir": lambda: os.chdir("/"),
    "close": _close_descriptors,
    "meddle": _meddle,
    "delete": lambda: Path(__file__).unlink(missing_ok=True),
    "": lambda: None,
}


class _Wild:
    """What both APIs share: two agents, six turns, and one call that goes wrong."""

    metadata: ClassVar[dict[str, Any]] = {"name": "wild_v0", "render_modes": ["rgb_array"]}

    def __init__(self, at: str = "", how: str = "", turn: int = 2, render_mode: Any = None) -> None:
        self.at, self.how, self.turn, self.now = at, how, turn, 0
        self.render_mode = render_mode
        self.possible_agents = ["ant", "bee"]
        self.agents: list[str] = []
        self.state_space = spaces.Box(0, 9, (1,), np.float32)
        self.call("init")

    def call(self, place: str) -> None:
        """Goes wrong where this is the place and the turn."""
        if place == self.at and (self.now >= self.turn or place in ("init", "reset", "close")):
            WAYS[self.how]()

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        self.call("space")
        return spaces.Box(0, 9, (1,), np.float32)

    def action_space(self, agent: str) -> spaces.Space[Any]:
        return spaces.Discrete(2)

    def state(self) -> Any:
        self.call("state")
        return np.array([self.now], np.float32)

    def render(self) -> Any:
        self.call("render")
        return np.zeros((4, 4, 3), np.uint8)

    def close(self) -> None:
        self.call("close")

    def see(self) -> Any:
        self.call("observe")
        return np.array([self.now], np.float32)


class WildTicks(_Wild, ParallelEnv):  # type: ignore[type-arg, misc]
    """The Parallel one."""

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        self.agents, self.now = list(self.possible_agents), 0
        self.call("reset")
        return {a: self.see() for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: Any) -> Any:
        self.now += 1
        self.call("step")
        live, is_over = self.agents, self.now >= 6
        self.agents = [] if is_over else live
        return (
            {a: self.see() for a in live},
            dict.fromkeys(live, 1.0),
            dict.fromkeys(live, is_over),
            dict.fromkeys(live, False),
            {a: {} for a in live},
        )


class WildTurns(_Wild, AECEnv):  # type: ignore[type-arg, misc]
    """The AEC one, its books as PettingZoo documents them."""

    def reset(self, seed: Any = None, options: Any = None) -> None:
        self.agents, self.now = list(self.possible_agents), 0
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: Any = {a: {} for a in self.agents}
        self.agent_selection = self.agents[0]
        self.call("reset")

    def observe(self, agent: str) -> Any:
        return self.see()

    def step(self, action: Any) -> None:
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self.now += 1
        self.call("step")
        self._cumulative_rewards[agent] = 0
        self.rewards = {a: float(a == agent) for a in self.agents}
        if self.now >= 6:
            self.terminations = dict.fromkeys(self.agents, True)
        place = self.agents.index(agent)
        self.agent_selection = self.agents[(place + 1) % len(self.agents)]
        self._accumulate_rewards()


def ticks(**settings: Any) -> WildTicks:
    """A new Parallel one."""
    return WildTicks(**settings)


def turns(**settings: Any) -> WildTurns:
    """A new AEC one."""
    return WildTurns(**settings)
