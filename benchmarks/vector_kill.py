"""What is left of a vector environment that is killed: kill -9 of its process or of a worker.

A process records `two_robot_line` from two workers and says which they are and what memory they
share. It, or one of its workers, is killed at a random instant. What must be so then:

    gone        no process of it is left
    unshared    no process maps the shared memory any more, and nothing has come into /dev/shm
    named       of a killed worker: the parent says which copies died, and of what
    evidence    the bundle can be read (of a killed parent: is recovered), and replays

One JSON line for each kind of kill: {"figure", "killed", "kills", "gone", "unshared", "named",
"evidence", "turns_least", "turns_most"}. Exits 1 where a number falls short of `kills`.

    python benchmarks/vector_kill.py [--who parent|worker] [--kills 50] [--seed 0]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import select
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from gamekeeper.record.bundle import load
from gamekeeper.record.recover import recover
from gamekeeper.record.replay import replay

FIGURE: Final = "vector_kill"
LATEST_S: Final = 2.0
"""Latest kill after the first step; the copies play many episodes until then."""
END_S: Final = 20.0
"""How long a process may take to be gone."""
KINDS: Final = ("parent", "worker")
PLAYER: Final = """
import os, sys
import gamekeeper as gk
from gamekeeper.errors import EnvError

venv = gk.record(gk.vector.make("two_robot_line", 8, engine="process", workers=2), sys.argv[1])
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
    given = parser.parse_args()
    rng = random.Random(given.seed)
    is_clean = True
    for kind in given.who or KINDS:
        found = [killed(kind, after_s=rng.uniform(0, LATEST_S)) for _ in range(given.kills)]
        counts = {
            name: sum(each[name] for each in found)
            for name in ("gone", "unshared", "named", "evidence")
        }
        is_clean = is_clean and all(count == given.kills for count in counts.values())
        turns = [each["turns"] for each in found]
        print(json.dumps({
            "figure": FIGURE, "killed": kind, "kills": given.kills, **counts,
            "turns_least": min(turns), "turns_most": max(turns),
        }), flush=True)  # fmt: skip
    return 0 if is_clean else 1


def killed(kind: str, *, after_s: float) -> dict[str, Any]:
    """One run, killed; what became of it."""
    before = set(Path("/dev/shm").iterdir())
    with tempfile.TemporaryDirectory(prefix="vector-kill-") as folder:
        out = Path(folder, "run")
        command = [sys.executable, "-c", PLAYER, str(out)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as player:
            assert player.stdout is not None
            memory, *workers = map(int, player.stdout.readline().split())
            descriptors = [os.pidfd_open(pid) for pid in (player.pid, *workers)]
            time.sleep(after_s)
            os.kill(player.pid if kind == "parent" else workers[0], signal.SIGKILL)
            said = player.stdout.read()
        is_gone = False not in [_has_ended(descriptor) for descriptor in descriptors]
        is_named = kind == "parent" or (
            player.returncode == 0 and "killed by signal 9" in said and "copy" in said
        )
        come = {path for path in set(Path("/dev/shm").iterdir()) - before if _is_ours(path)}
        is_unshared = not come and not _maps(memory)
        is_evidence, turns = _evidence(out, is_torn=kind == "parent")
    return {
        "gone": is_gone, "unshared": is_unshared, "named": is_named, "evidence": is_evidence,
        "turns": turns,
    }  # fmt: skip


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
    """Whether the bundle can be read and replays, and how many turns it holds."""
    if is_torn:
        recover(out)
    evidence = load(out)
    turns = int(evidence.steps.num_rows)
    return replay(out).verified if turns else True, turns


if __name__ == "__main__":
    sys.exit(main())
