"""What a recording loses when one of its processes is killed: kill -9 at random instants.

`--who writer`: a process that records itself. A small environment appends every turn that it
finished to a log of its own, with fsync and the time of the wall clock; a turn takes 1 to 3 ms. The
process is killed at a random instant, its run is read, recovered and replayed, and what the log
has beyond the evidence is what was lost: how long before the kill its oldest turn was finished.

With `--keep` it retains the last two episodes, and its folder is bounded so that old segments are
written anew several times a second; turns of episodes that were dropped aren't lost.

`--who parent`, `worker`, `merger`: one of the processes of `gamekeeper rollout --workers 2`; see
`benchmarks/kill_apart.py`.

Prints a JSON line; of a writer {"figure": "kill", "who", "kills", "opened", "recovered",
"replayed", "lost_ms_median", "lost_ms_max", "late": kills that lost anything older than 100 ms}.
Exits 1 where anything wasn't as it should be.

    python benchmarks/kill.py [--who writer] [--level full] [--keep] [--kills 200]
        [--seed 0] [--cold] [--minutes M]
"""

import argparse
import json
import math
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gamekeeper.episodes.encoder import LEVELS
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.known_extent import env_steps
from gamekeeper.interface.opening import open_env
from gamekeeper.runs.comparison import replay_evidence
from gamekeeper.runs.load_run import load
from gamekeeper.runs.run_check import recover

try:
    from benchmarks import kill_apart
except ImportError:  # run as a script
    import kill_apart  # type: ignore[no-redef]

BOUND_MS: Final = 100.0
KEEP: Final = "last 2, 20 kB"
EARLIEST_S: Final = 0.05  # after the first turn
LATEST_S: Final = 2.5  # columns are made once a second
BEGIN_S: Final = 120.0  # for the first turn; then the recorder has died, or hangs
ENVIRONMENT: Final = '''
import os, time
import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv


class Logged(ParallelEnv):
    """Two agents walk at random; every finished turn is on the disk before `step` returns."""

    metadata = {"name": "logged_v0"}
    render_mode = None

    def __init__(self, log=None):
        self.log = None if log is None else os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self.possible_agents = ["a", "b"]
        self.observation_spaces = {a: spaces.Box(-9, 9, (8,), np.float64) for a in "ab"}
        self.action_spaces = {a: spaces.Discrete(3) for a in "ab"}
        self.episode = -1

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents, self.turn, self.episode = ["a", "b"], 0, self.episode + 1
        return self.see(), {a: {} for a in "ab"}

    def see(self):
        return {a: self.rng.normal(size=8) for a in "ab"}

    def step(self, actions):
        self.turn += 1
        ended = self.turn == 150
        out = self.see(), {a: float(actions[a]) for a in "ab"}
        flags = {a: ended for a in "ab"}, {a: False for a in "ab"}
        self.agents = [] if ended else ["a", "b"]
        if self.log is not None:
            time.sleep(0.001 + 0.002 * (self.turn % 3) / 2)
            line = f"{self.episode} {self.turn} {time.time_ns()}\\n".encode()
            os.write(self.log, line)
            os.fsync(self.log)
        return *out, *flags, {a: {"turn": self.turn} for a in "ab"}
'''
RECORDERS: Final = """
import os, sys
from logged import Logged
from gamekeeper.runs.recording import record
from gamekeeper.runs.ring import keep_rule

keep_rule.LEAST_BYTES = 1


def play(log, run):
    env = record(Logged(log), run, level=sys.argv[1], keep=sys.argv[2] or None, check=False)
    for seed in range(10_000):
        env.reset(seed=seed)
        while env.agents:
            env.step({agent: (seed + env.unwrapped.turn) % 3 for agent in env.agents})


for line in sys.stdin:
    pid = os.fork()  # what takes longest, importing, was done once for all
    if not pid:
        play(*line.rstrip("\\n").split("\\t"))
        os._exit(0)
    print(pid, flush=True)
    print(os.waitpid(pid, 0)[1], flush=True)
"""


@dataclass(frozen=True, slots=True)
class Killed:
    """What became of one killed recording; `lost_ms` is 0.0 where nothing was lost."""

    turns: int
    is_opened: bool
    is_recovered: bool
    is_replayed: bool
    lost_ms: float


def main() -> int:
    """Kills as often as asked for; 1 if anything wasn't as it should be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--who", choices=["writer", *kill_apart.WHO], default="writer")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--level", choices=LEVELS, default="full", help="of a writer's run")
    parser.add_argument("--keep", action="store_true", help="of a writer: drop episodes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=math.inf, help="not of a writer")
    parser.add_argument("--cold", action="store_true", help="workers begin as always")
    given = parser.parse_args()
    rng = random.Random(given.seed)
    with tempfile.TemporaryDirectory(prefix="kill-") as folder:
        if given.who != "writer":
            figures, is_whole = kill_apart.kill(
                given.who,
                Path(folder),
                kills=given.kills,
                rng=rng,
                is_cold=given.cold,
                most_s=given.minutes * 60,
            )
            print(json.dumps(figures))
            return 0 if is_whole else 1
        with recorders(Path(folder), given.level, KEEP if given.keep else "") as start:
            found = [
                killed(start, Path(folder), number, after_s=rng.uniform(EARLIEST_S, LATEST_S))
                for number in range(given.kills)
            ]
    print(json.dumps({**figure(found), "level": given.level, "keep": given.keep}))
    whole = all(each.is_opened and each.is_recovered and each.is_replayed for each in found)
    return 0 if whole and all(each.lost_ms <= BOUND_MS for each in found) else 1


@contextmanager
def recorders(folder: Path, level: str, keep: str) -> Iterator[subprocess.Popen[str]]:
    """A process that forks a recorder for every line (log, run) that it is given."""
    # pyarrow imports pandas where there is one, which takes longer than all the rest
    (folder / "pandas.py").write_text("raise ImportError", encoding="utf-8")
    (folder / "logged.py").write_text(textwrap.dedent(ENVIRONMENT), encoding="utf-8")
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    with subprocess.Popen(
        [sys.executable, "-c", RECORDERS, level, keep],
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield process


def killed(start: subprocess.Popen[str], folder: Path, number: int, *, after_s: float) -> Killed:
    """One recording, killed `after_s` seconds after its first turn."""
    assert start.stdin is not None
    assert start.stdout is not None
    log, run = folder / f"{number}.log", folder / f"{number}"
    start.stdin.write(f"{log}\t{run}\n")
    start.stdin.flush()
    pid, latest_s = int(start.stdout.readline()), time.monotonic() + BEGIN_S
    while not (log.exists() and log.stat().st_size):
        if start.poll() is not None or time.monotonic() > latest_s:
            raise SystemExit(f"no turn came within {BEGIN_S:g} s; {start.returncode=}")
        time.sleep(0.005)
    time.sleep(after_s)
    killed_ns = time.time_ns()
    os.kill(pid, signal.SIGKILL)
    if int(start.stdout.readline()) != signal.SIGKILL:
        raise SystemExit("the recorder ended by itself")
    found = looked_at(run, log, killed_ns, environment=folder / "logged.py")
    shutil.rmtree(run)
    return found


def looked_at(run: Path, log: Path, killed_ns: int, *, environment: Path) -> Killed:
    """Reads, recovers and replays what a killed recorder left."""
    evidence = load(run)
    kept = {
        (header["episode"], turn + 1)
        for header in evidence.episode_table.to_pylist()
        for turn in range(_env_steps(evidence, header["episode"]))
    }
    finished = [tuple(map(int, line.split())) for line in log.read_text().splitlines()]
    episodes = evidence.episode_table["episode"].to_pylist()
    was_dropped = set(range(max(episodes, default=0))) - set(episodes)
    lost = [
        ns
        for episode, turn, ns in finished
        if (episode, turn) not in kept and episode not in was_dropped
    ]
    lost_ms = max(((killed_ns - ns) / 1e6 for ns in lost), default=0.0)
    finalized = recover(run)
    opened = open_env(f"{environment}:Logged", api="parallel")
    return Killed(
        turns=len(kept),
        is_opened=evidence.manifest["status"] == "open",
        is_recovered=finalized.manifest["status"] == "recovered"
        and len(kept) == _total(finalized)
        and _is_counted(finalized),
        is_replayed=replay_evidence(finalized, opened).verified,
        lost_ms=max(lost_ms, 0.0),
    )


def figure(found: list[Killed]) -> dict[str, object]:
    """The figures of all kills together."""
    lost = [each.lost_ms for each in found]
    return {
        "figure": "kill",
        "who": "writer",
        "kills": len(found),
        "opened": sum(each.is_opened for each in found),
        "recovered": sum(each.is_recovered for each in found),
        "replayed": sum(each.is_replayed for each in found),
        "turns": sum(each.turns for each in found),
        "lost_ms_median": round(statistics.median(lost), 1),
        "lost_ms_max": round(max(lost), 1),
        "late": sum(each > BOUND_MS for each in lost),
    }


def _env_steps(evidence: Evidence, episode: int) -> int:
    timings = evidence.tables.episode("timings", episode)
    if timings is None:  # killed before the first of them came: whole turns may be there already
        return env_steps(evidence.episode(episode))
    return timings.num_rows


def _is_counted(evidence: Evidence) -> bool:
    """True unless the counts of dropped and retained episodes don't come to those that began."""
    keep, episodes = evidence.manifest.get("keep"), evidence.episode_table["episode"]
    if keep is None or not len(episodes):
        return True
    began = episodes[-1].as_py() + 1
    return bool(keep["seen"] == keep["dropped"]["episodes"] + len(episodes) == began)


def _total(evidence: Evidence) -> int:
    return sum(evidence.episode_table["turns"].to_pylist())


if __name__ == "__main__":
    sys.exit(main())
