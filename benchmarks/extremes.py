"""Extremes that no test has the time for: one very long episode, one very large observation.

    python benchmarks/extremes.py --turns 10000000        # one AEC episode, with every command
    python benchmarks/extremes.py --observation-mb 100    # both levels
    python benchmarks/extremes.py --agents 10000
    python benchmarks/extremes.py --turns 300000 --parts record,replay

Prints a JSON line a figure. Memory is the peak of the process's resident set (ru_maxrss), so each
figure is measured in a process of its own; time is processor time, of the process and of those that
it started. `before_mb` is what the process had before its work began.
"""

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
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk
from gamekeeper.interface.opening import open_env
from gamekeeper.runs.comparison import replay_evidence
from gamekeeper.runs.run_check import verify

Part: TypeAlias = "Callable[[Turns, Path, argparse.Namespace], dict[str, Any]]"


class Turns(gk.TurnEnv):
    """Agents take turns; who acts is paid, at the very end `final`; after `turns` turns all end."""

    metadata = {"name": "extreme_turns_v0"}  # noqa: RUF012  # as PettingZoo declares it

    def __init__(
        self, agents: int = 2, turns: int = 100, size: int = 4, final: float = 1.0
    ) -> None:
        super().__init__()
        self.most, self.taken, self.final = turns, 0, final
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
        self.add_reward(agent, self.final if self.taken >= self.most else 1.0)
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
    parser.add_argument("--parts", help=f"of {','.join(PARTS)}; all unless told")
    parser.add_argument("--part", help=argparse.SUPPRESS)
    parser.add_argument("--run", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.part:
        print(json.dumps(measured(given)))
        return
    levels = ["full", "digest"] if given.observation_mb else [given.level]
    for level in levels:
        with tempfile.TemporaryDirectory() as folder:
            for part in given.parts.split(",") if given.parts else PARTS:
                words = [*sys.argv[1:], "--level", level, "--part", part, "--run", f"{folder}/run"]
                subprocess.run([sys.executable, __file__, *words], check=False)


def game_of(given: argparse.Namespace, *, final: float = 1.0) -> Turns:
    """The environment that the command line describes."""
    if given.turns:
        return Turns(turns=given.turns, final=final)
    if given.observation_mb:
        return Turns(agents=1, turns=2, size=given.observation_mb * 250_000, final=final)
    return Turns(agents=given.agents, turns=2 * given.agents, final=final)


def measured(given: argparse.Namespace) -> dict[str, Any]:
    """One part: how long it took the processor, and the most memory that it had."""
    game, run = game_of(given), given.run
    before_mb, _ = used()
    begun_s, cpu_s = time.monotonic(), used()[1]
    told = PARTS[given.part](game, run, given)
    peak_mb, after_s = used()
    return {
        "part": given.part,
        "level": given.level,
        "turns": given.turns,
        "agents": given.agents,
        "observation_mb": given.observation_mb,
        **told,
        "cpu_s": round(after_s - cpu_s, 2),
        "wall_s": round(time.monotonic() - begun_s, 2),
        "before_mb": round(before_mb),
        "peak_mb": round(peak_mb),
        "disk_mb": round(sum(map(size_of, files_in(run))) / 1e6, 1),
        "load": round(os.getloadavg()[0], 1),
    }


def used() -> tuple[float, float]:
    """Peak of the resident set in MB, and processor time: of this process and its children."""
    every = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cpu_s = sum(each.ru_utime + each.ru_stime for each in every)
    return max(each.ru_maxrss for each in every) / 1024, cpu_s


def files_in(run: Path) -> Iterator[Path]:
    """The files of a run."""
    return (path for path in run.rglob("*") if path.is_file())


def size_of(path: Path) -> int:
    """Bytes of a file."""
    return path.stat().st_size


def recorded(game: Turns, run: Path, given: argparse.Namespace) -> dict[str, Any]:
    """One episode, whole."""
    play(game, run, given)
    evidence = gk.load(run)
    return {
        "status": evidence.manifest["status"],
        "played": evidence.episode_table["turns"].to_pylist(),
    }


def play(game: Turns, run: Path, given: argparse.Namespace) -> None:
    """Plays and records one episode."""
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


def recorded_again(game: Turns, run: Path, given: argparse.Namespace) -> dict[str, Any]:
    """A second run, which differs from the first in its last turn."""
    play(game_of(given, final=2.0), run.parent / "other", given)
    return {}


def viewed(game: Turns, run: Path, given: argparse.Namespace) -> dict[str, Any]:
    """What a browser asks for when it opens `gamekeeper view`: the page, its list, the episode."""
    from gamekeeper.viewing.viewer import ServedRuns

    shelf = ServedRuns([run])
    sizes = [len(shelf.page("/").body), len(json.dumps(shelf.index("")))]
    episode = shelf.episode("a", 0)
    return {"bytes": [*sizes, 0 if episode is None else len(episode.body)]}


def commanded(command: str, *words: object) -> dict[str, Any]:
    """A command line in a process of its own, what it prints thrown away."""
    line = [sys.executable, "-m", "gamekeeper", command, *map(str, words)]
    done = subprocess.run(line, stdout=subprocess.DEVNULL, check=False)
    return {"exit": done.returncode}


def of_command(command: str, *words: object) -> Part:
    """A part that is one command about the run; RUN's folder is where `{}` may write."""

    def part(game: Turns, run: Path, given: argparse.Namespace) -> dict[str, Any]:
        return commanded(command, run, *(str(word).format(run.parent) for word in words))

    return part


SUM: Final = "SELECT agent, sum(reward) FROM agent_steps GROUP BY agent"
PARTS: dict[str, Part] = {
    "record": recorded,
    "open": opened,
    "verify": verified,
    "replay": replayed,
    "show": of_command("show"),
    "query": of_command("query", SUM),
    "second": recorded_again,
    "diff": of_command("diff", "{}/other"),
    "report": of_command("report", "--out", "{}/report.html"),
    "view": viewed,
    "export": of_command("export", "--to", "numpy", "--out", "{}/run.npz"),
}


if __name__ == "__main__":
    main()
