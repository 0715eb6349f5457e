"""How long `gamekeeper report` takes, and how large its page is.

A run of 200 episodes, 500 turns, 8 agents with 16 numbers of observation, rewards in two terms,
masks, infos with positions and a declared failure is recorded once (or taken from --run). Then the
page is written, in this process, with its sections and episodes.

Prints a JSON line: {"figure": "report", "episodes", "turns", "agents", "wall_s", "cpu_s",
"page_bytes", "packed": episodes on the page, "rss_mb": most memory of this process}. With --out the
page is kept.

    python benchmarks/report.py [--run RUN] [--episodes 200] [--turns 500] [--out FILE] [--profile]
"""

import argparse
import cProfile
import json
import pstats
import resource
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.viewing.report_file import report

AGENTS: Final = 8
NUMBERS: Final = 16
MOVES: Final = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
SIDE: Final = 20
CONTRACT: Final = {
    "name": "patrol_v0",
    "api": "parallel",
    "roles": {"guard": {"agents": "guard_*", "noop": 0, "mask": "infos.action_mask"}},
    "rewards": {"found": {"kind": "individual"}, "effort": {"kind": "individual"}},
    "failure": {"team": "found < 90"},
}


class Patrol(gk.TickEnv):
    """Guards walk on a grid, are paid for cells that nobody was at for long, and pay for moves."""

    metadata: Mapping[str, Any] = {"name": "patrol_v0", "render_modes": []}

    def __init__(self, turns: int = 500, render_mode: str | None = None) -> None:
        """Episodes have so many turns."""
        super().__init__(render_mode=render_mode)
        self.length = turns
        self.possible_agents = [f"guard_{number}" for number in range(AGENTS)]
        sight = Box(-np.inf, np.inf, (NUMBERS,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, sight)
        self.action_spaces = dict.fromkeys(self.possible_agents, Discrete(len(MOVES)))

    def start(self, rng: Any, options: Any) -> None:
        """Everybody stands somewhere."""
        del options
        self.now = 0
        self.at = {agent: [rng.integers(SIDE), rng.integers(SIDE)] for agent in self.agents}
        self.last = np.full((SIDE, SIDE), -100)

    def tick(self, actions: Any) -> None:
        """Moves all, pays, and ends when it is time."""
        self.now += 1
        for agent, action in actions.items():
            dx, dy = MOVES[int(action)]
            x, y = self.at[agent]
            x, y = min(max(x + dx, 0), SIDE - 1), min(max(y + dy, 0), SIDE - 1)
            self.at[agent] = [x, y]
            self.add_reward(agent, -0.01 if action else 0.0, term="effort")
            if self.now - self.last[x, y] >= 100:
                self.add_reward(agent, 1.0, term="found")
            self.last[x, y] = self.now
        if self.now >= self.length:
            for agent in self.agents:
                self.truncate(agent, "horizon")

    def observe(self, agent: Any) -> Any:
        """Where all are, from its own place."""
        x, y = self.at[agent]
        flat = [value for ox, oy in self.at.values() for value in (ox - x, oy - y)]
        return np.asarray(flat[:NUMBERS], np.float32)

    def mask(self, agent: Any) -> Any:
        """No step beyond the border."""
        x, y = self.at[agent]
        inside = [(0 <= x + dx < SIDE) and (0 <= y + dy < SIDE) for dx, dy in MOVES]
        return np.asarray(inside, np.int8)

    def info(self, agent: Any) -> dict[str, Any]:
        """Its place, and since when it walks."""
        return {"position": np.asarray(self.at[agent]), "walked": self.now}


def make(turns: int = 500) -> Patrol:
    """The environment."""
    return Patrol(turns)


def recorded(folder: Path, episodes: int, turns: int) -> Path:
    """A run of random play."""
    gk.rollout(
        f"parallel:{Path(__file__).resolve()}:make",
        policies="random",
        episodes=episodes,
        seed=0,
        out=folder,
        env_kwargs={"turns": turns},
        contract=Contract.from_json(CONTRACT),
    )
    return folder


def measured(run: Path, out: Path) -> dict[str, Any]:
    """One page of the run."""
    wall, cpu = time.perf_counter(), time.process_time()
    page = report(run, out)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    evidence = gk.load(run, check=False)
    return {
        "figure": "report",
        "episodes": evidence.episode_table.num_rows,
        "turns": int(evidence.episode_table["turns"][0].as_py()),
        "agents": len(evidence.manifest["agents"]),
        "wall_s": round(wall, 2),
        "cpu_s": round(cpu, 2),
        "page_bytes": page.stat().st_size,
        "packed": page.read_text(encoding="utf-8").count('id="gk-episode-'),
        "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }


def main() -> int:
    """Records where needed, writes the page, prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--run", type=Path)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--turns", type=int, default=500)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--profile", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = given.run or Path(folder) / "patrol"
        if not run.exists():
            recorded(run, given.episodes, given.turns)
        out = given.out or Path(folder) / "report.html"
        with cProfile.Profile() as profile:
            profile.disable() if not given.profile else None
            figures = measured(run, out)
    print(json.dumps(figures))
    if given.profile:
        pstats.Stats(profile, stream=sys.stderr).sort_stats("cumulative").print_stats(45)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
