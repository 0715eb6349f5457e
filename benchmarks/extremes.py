"""Extremes that no test has the time for: one very long episode, one very large observation.

    python benchmarks/extremes.py --turns 10000000        # one AEC episode, recorded and verified
    python benchmarks/extremes.py --observation-mb 100    # both levels
    python benchmarks/extremes.py --agents 10000          # recorded, replayed, shown, reported

Prints a JSON line a figure. Memory is the peak of the process's resident set (ru_maxrss), so each
figure is measured in a process of its own; time is processor time.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk
from gamekeeper.game.open import open_env
from gamekeeper.record.replay import replay_evidence
from gamekeeper.record.verify import verify


class Turns(gk.TurnEnv):
    """Agents take turns; the one in turn is paid; after `turns` turns all have ended."""

    metadata = {"name": "extreme_turns_v0"}  # noqa: RUF012  # as PettingZoo declares it

    def __init__(self, agents: int = 2, turns: int = 100, size: int = 4) -> None:
        super().__init__()
        self.most, self.taken = turns, 0
        self.possible_agents = [f"agent_{i}" for i in range(agents)]
        space = Box(0, 1, (size,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, space)
        self.action_spaces = dict.fromkeys(self.possible_agents, Discrete(2))
        self.seen = np.ones(size, np.float32)

    def start(self, rng: Any, options: Any) -> None:
        """The first turn comes."""
        self.taken = 0

    def act(self, agent: Any, action: Any) -> None:
        """Pays the agent in turn."""
        self.taken += 1
        self.pay(agent, 1.0)
        if self.taken >= self.most:
            for each in list(self.agents):
                self.terminate(each, "over")

    def observe(self, agent: Any) -> Any:
        """Ones."""
        return self.seen


def main() -> None:
    """Measures what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int)
    parser.add_argument("--observation-mb", type=int)
    parser.add_argument("--agents", type=int)
    parser.add_argument("--level", default="full")
    parser.add_argument("--part", help=argparse.SUPPRESS)
    parser.add_argument("--run", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.part:
        print(json.dumps(measured(given)))
        return
    levels = ["full", "digest"] if given.observation_mb else [given.level]
    for level in levels:
        with tempfile.TemporaryDirectory() as folder:
            for part in PARTS:
                words = [*sys.argv[1:], "--level", level, "--part", part, "--run", f"{folder}/run"]
                subprocess.run([sys.executable, __file__, *words], check=False)


def game_of(given: argparse.Namespace) -> Turns:
    """The environment that the command line describes."""
    if given.turns:
        return Turns(turns=given.turns)
    if given.observation_mb:
        return Turns(agents=1, turns=2, size=given.observation_mb * 250_000)
    return Turns(agents=given.agents, turns=2 * given.agents)


def measured(given: argparse.Namespace) -> dict[str, Any]:
    """One part: how long it took the processor, and the most memory that it had."""
    game, run = game_of(given), given.run
    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    begun_s, cpu_s = time.monotonic(), time.process_time()
    told = PARTS[given.part](game, run, given)
    return {
        "part": given.part, "level": given.level, "turns": given.turns, "agents": given.agents,
        "observation_mb": given.observation_mb, **told,
        "cpu_s": round(time.process_time() - cpu_s, 2),
        "wall_s": round(time.monotonic() - begun_s, 2), "before_mb": round(before_mb),
        "peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "disk_mb": round(sum(map(size_of, files_in(run))) / 1e6, 1),
        "load": round(os.getloadavg()[0], 1),
    }  # fmt: skip


def files_in(run: Path) -> Iterator[Path]:
    """The files of a run."""
    return (path for path in run.rglob("*") if path.is_file())


def size_of(path: Path) -> int:
    """Bytes of a file."""
    return path.stat().st_size


def recorded(game: Turns, run: Path, given: argparse.Namespace) -> dict[str, Any]:
    """One episode, whole."""
    env = gk.record(game, run, level=given.level)
    env.reset(seed=1)
    step, agents = env.step, env.unwrapped
    if given.observation_mb:
        while agents.agents:
            over = env.last()[2]
            step(None if over else 0)
    else:
        while agents.agents:
            step(None if agents.terminations[agents.agent_selection] else 0)
    env.close()
    evidence = gk.load(run)
    return {"status": evidence.manifest["status"], "played": evidence.episodes["turns"].to_pylist()}


def opened(game: Turns, run: Path, given: argparse.Namespace) -> dict[str, Any]:
    """What each agent came to."""
    agents = gk.load(run).summary.agents
    return {"returns": [agent.return_mean for agent in agents.values()][:2]}


def verified(game: Turns, run: Path, given: argparse.Namespace) -> dict[str, Any]:
    """Every hash looked at again."""
    return {"ok": verify(run).ok}


def replayed(game: Turns, run: Path, given: argparse.Namespace) -> dict[str, Any]:
    """Played again, row by row."""
    return {"verified": replay_evidence(gk.load(run), open_env(game)).verified}


PARTS: dict[str, Callable[[Turns, Path, argparse.Namespace], dict[str, Any]]] = {
    "record": recorded, "open": opened, "verify": verified, "replay": replayed,
}  # fmt: skip


if __name__ == "__main__":
    main()
