"""What is left of a vector environment that is killed: kill -9 of its process or of a worker.

A process records `two_robot_line` from two workers and says which they are and what memory they
share. It, or one of its workers, is killed at a random instant. All are forks of a process that has
imported everything (`benchmarks/forks.py`); with `--cold` workers begin as always. What must be so:

    gone        no process of it is left
    unshared    no process maps the shared memory any more, and nothing has come into /dev/shm
    named       of a killed worker: the parent says which copies died, and of what
    evidence    the run can be read (of a killed parent: is recovered), and replays

One JSON line for each kind of kill: {"figure", "killed", "kills", "gone", "unshared", "named",
"evidence", "turns_least", "turns_most"}. Exits 1 where a number falls short of `kills`.

    python benchmarks/vector_kill.py [--who parent|worker] [--kills 50] [--seed 0] [--cold]
"""

import argparse
import json
import os
import random
import select
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from gamekeeper.interface.opening import open_env
from gamekeeper.runs.comparison import replay_evidence
from gamekeeper.runs.load_run import load
from gamekeeper.runs.run_check import recover

try:
    from benchmarks.forks import Forks, forks, is_there
except ImportError:  # run as a script
    from forks import Forks, forks, is_there  # type: ignore[no-redef]

FIGURE: Final = "vector_kill"
TASK: Final = "two_robot_line"
LATEST_S: Final = 1.0
"""Latest kill after the first step; the copies play many episodes until then."""
LOOK_S: Final = 0.005
END_S: Final = 20.0
"""How long a process may take to be gone."""
KINDS: Final = ("parent", "worker")
CLAIMS: Final = ("gone", "unshared", "named", "evidence")
MODULES: Final = ("gamekeeper.vector", "gamekeeper.vector.process_engine")
"""Imported before the players and their workers are forked."""
PLAYER: Final = """
import os, sys
import gamekeeper as gk
from gamekeeper.errors import EnvError

venv = gk.record(gk.vector.make("two_robot_line", 8, engine="process", workers=2), sys.argv[2])
venv.reset(seed=1)
venv.action_space.seed(0)
engine = venv._engine
memory = os.fstat(engine._shared.fd).st_ino
print(memory, *(worker.process._process.pid for worker in engine._workers), flush=True)
try:
    while True:
        venv.step(venv.action_space.sample())
except EnvError as error:
    print(str(error).splitlines()[0], flush=True)
    venv.close()
"""


def main() -> int:
    """Kills as often as asked for; 1 if anything was left behind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--who", action="append", choices=KINDS, help="both, unless told")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cold", action="store_true", help="workers begin as always")
    given = parser.parse_args()
    rng = random.Random(given.seed)
    is_clean = True
    with forks(*MODULES, is_cold=given.cold) as start:
        for kind in given.who or KINDS:
            waits = [rng.uniform(0, LATEST_S) for _ in range(given.kills)]
            figures = figure(kind, [killed(start, kind, after_s=each) for each in waits])
            print(json.dumps({**figures, "cold": given.cold}), flush=True)
            is_clean = is_clean and all(figures[claim] == given.kills for claim in CLAIMS)
    return 0 if is_clean else 1


def figure(kind: str, found: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures of all kills of a kind together."""
    turns = [each["turns"] for each in found]
    return {
        "figure": FIGURE,
        "killed": kind,
        "kills": len(found),
        **{claim: sum(each[claim] for each in found) for claim in CLAIMS},
        "turns_least": min(turns),
        "turns_most": max(turns),
    }


def killed(start: Forks, kind: str, *, after_s: float) -> dict[str, Any]:
    """One run, killed; what became of it."""
    before = set(Path("/dev/shm").iterdir())
    with tempfile.TemporaryDirectory(prefix="vector-kill-") as folder:
        out, told = Path(folder, "run"), Path(folder, "said")
        player = start.begin(["-c", PLAYER, str(out)], str(told))
        memory, *workers = map(int, _first_line(told, player).split())
        descriptors = [os.pidfd_open(pid) for pid in (player, *workers)]
        time.sleep(after_s)
        os.kill(player if kind == "parent" else workers[0], signal.SIGKILL)
        code = start.code()
        said = told.read_text()
        is_gone = False not in [_has_ended(descriptor) for descriptor in descriptors]
        is_named = kind == "parent" or (
            code == 0 and "killed by signal 9" in said and "copy" in said
        )
        come = {path for path in set(Path("/dev/shm").iterdir()) - before if _is_ours(path)}
        is_unshared = not come and not _maps(memory)
        is_evidence, turns = _evidence(out, is_torn=kind == "parent")
    return {
        "gone": is_gone,
        "unshared": is_unshared,
        "named": is_named,
        "evidence": is_evidence,
        "turns": turns,
    }


def _first_line(told: Path, player: int) -> str:
    """What the player says first, once it has."""
    while True:
        said = told.read_text() if told.exists() else ""
        line, end, _ = said.partition("\n")
        if end:
            return line
        if not is_there(player):
            raise SystemExit(f"the player ended by itself: {said}")
        time.sleep(LOOK_S)


def _has_ended(descriptor: int) -> bool:
    """Whether a process is gone, or goes in time."""
    ready = select.select([descriptor], [], [], END_S)[0]
    os.close(descriptor)
    return bool(ready)


def _is_ours(path: Path) -> bool:
    return "gamekeeper" in path.name or path.name.startswith(("psm_", "sem."))


def _maps(memory: int) -> bool:
    """Whether any process still maps the memory."""
    for maps in Path("/proc").glob("[0-9]*/maps"):
        try:
            lines = maps.read_text().splitlines()
        except OSError:  # gone meanwhile
            continue
        if any(f" {memory} " in line and "gamekeeper-vector" in line for line in lines):
            return True
    return False


def _evidence(out: Path, *, is_torn: bool) -> tuple[bool, int]:
    """Whether the run can be read and replays, and how many turns it holds."""
    if is_torn:
        recover(out)
    evidence = load(out)
    turns = int(evidence.agent_steps.num_rows)
    if not turns:
        return True, 0
    return replay_evidence(evidence, open_env(TASK, api="parallel")).verified, turns


if __name__ == "__main__":
    sys.exit(main())
