"""What a recording by workers loses by kill -9 of one of its processes, at random instants.

`gamekeeper rollout two_robot_line --workers 2` is a parent, two workers that play parts, and at the
end a process that merges them. One of them is killed at a random instant of the command's life, and
the same command is given again, until it ends by itself. What must be so then:

    gone      no process of a killed parent is left, within `END_S`
    untorn    where the run's folder should be lies nothing yet, or all of it, finalized
    told      of a killed worker or merger: the command ends with 0 or says what died, no traceback
    same      the fingerprint is the one of a single process that nobody killed
    clean     beside the run's folder lies nothing: no parts, no draft

A worker that is killed three times at one part ends the run as failed, as it should ("given_up";
"nothing" where that was the first part, and no turn of it was written). The command and its workers
are forks of a process that has imported everything (`benchmarks/forks.py`), so that the instants
fall into their work; cold, the workers begin as always, and most instants fall into their imports.
Used by `benchmarks/kill.py --who parent|worker|merger [--cold]`.
"""

import math
import os
import random
import shutil
import signal
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from gamekeeper.runs.load_run import load
from gamekeeper.runs.parts.part_plan import parts_folder
from gamekeeper.runs.recording import rollout
from gamekeeper.runs.run_check import verify

try:
    from benchmarks.forks import Forks, children_of, forks, is_there
except ImportError:  # run as a script
    from forks import Forks, children_of, forks, is_there  # type: ignore[no-redef]

WHO: Final = ("parent", "worker", "merger")
TASK: Final = "two_robot_line"
EPISODES: Final = 8
END_S: Final = 30.0
"""How long the processes of a killed parent may take to be gone."""
BEGINNINGS: Final = 20
LOOK_S: Final = 0.002
AGAIN: Final = "the same command"
"""What a command says that didn't end its work, and has lost none of it."""


@dataclass(slots=True)
class Field:
    """One run's folder, the command that records it, and what was seen so far."""

    start: Forks
    folder: Path
    wanted: str
    rng: random.Random
    life_s: float = 0.0
    begun_s: float = 0.0
    counts: Counter[str] = field(default_factory=Counter)

    @property
    def run(self) -> Path:
        """Where the evidence comes to lie."""
        return self.folder / "run"

    def begin(self) -> int:
        """The command begins; its process."""
        words = ["rollout", TASK, "--episodes", str(EPISODES), "--workers", "2", "--quiet"]
        pid = self.start.begin([*words, "--out", str(self.run)], str(self.folder / "said"))
        self.begun_s = time.monotonic()
        return pid

    def code(self) -> int:
        """Waits for the command's end; its exit code."""
        return self.start.code()

    def sleep(self) -> None:
        """Until a random instant of the command's life."""
        time.sleep(self.rng.uniform(0.0, self.life_s))

    def seen(self, *, times: int = 1, **claims: bool) -> None:
        """Counts the claims that hold, and shows what was said where one doesn't."""
        for name, holds in claims.items():
            self.counts[name] += times * holds
            if not holds:
                sys.stderr.write(f"not {name}: {self.said()}\n")

    def after_kills(self, kills: int, **claims: bool) -> None:
        """What has to be so after each of so many kills."""
        is_there = self.run.exists() and any(self.run.iterdir())
        self.counts["kills"] += kills
        self.seen(times=kills, untorn=not is_there or verify(self.run).ok, **claims)

    def ended(self, code: int) -> None:
        """What has to be so when the command has ended by itself."""
        self.counts["ends"] += 1
        left, lived_s = {"run", "said"}, time.monotonic() - self.begun_s
        if code == 1 and not self.run.exists():  # killed thrice before its first turn
            self.counts["nothing"] += 1
            self.seen(same="killed by SIGKILL" in self.said())
            left = {"said"}
            if parts_folder(self.run).exists():  # other parts were whole, and are gone on from
                left.add(parts_folder(self.run).name)
        elif code == 1 and load(self.run).manifest["status"] == "failed":
            self.counts["given_up"] += 1
            self.seen(same="killed by SIGKILL" in self.said())
        else:
            self.life_s = 0.5 * (self.life_s or lived_s) + 0.5 * lived_s
            self.seen(same=code == 0 and load(self.run).fingerprint == self.wanted)
        self.seen(clean={path.name for path in self.folder.iterdir()} == left)
        shutil.rmtree(self.run, ignore_errors=True)

    def said(self) -> str:
        """What the last command said."""
        return (self.folder / "said").read_text(encoding="utf-8", errors="replace")


def kill(
    who: str,
    folder: Path,
    *,
    kills: int,
    rng: random.Random,
    is_cold: bool = False,
    most_s: float = math.inf,
) -> tuple[dict[str, Any], bool]:
    """The figures of so many kills, or of as many as time allows; whether all was as it should be.

    Args:
        most_s: wall time after which no other command is begun.
    """
    one = rollout(TASK, episodes=EPISODES, seed=0)
    with forks(is_cold=is_cold) as start:
        (folder / "field").mkdir()
        found = Field(start, folder / "field", one.fingerprint, rng)
        found.begin()
        found.ended(found.code())  # how long it lives when nobody kills
        template = _parts_ready(found, folder / "ready") if who == "merger" else None
        end_s = time.monotonic() + most_s
        while found.counts["kills"] < kills and time.monotonic() < end_s:
            if who == "parent":
                _kill_parent(found)
            elif who == "worker":
                _kill_worker(found, most=kills)
            else:
                assert template is not None
                _kill_merger(found, template)
        found.begin()  # what the last one left behind is gone on from, too
        found.ended(found.code())
    counts = found.counts
    each = ("gone", "untorn") if who == "parent" else ("untorn", "told")
    is_whole = all(counts[name] == counts["kills"] for name in each)
    is_whole = is_whole and counts["same"] == counts["clean"] == counts["ends"]
    return {"figure": "kill", "who": who, "cold": is_cold, **counts}, is_whole


def _kill_parent(found: Field) -> None:
    pid = found.begin()
    found.sleep()
    if not is_there(pid):
        found.ended(found.code())
        return
    os.kill(pid, signal.SIGSTOP)  # so that it starts nobody while its children are looked for
    children = children_of(pid)
    os.kill(pid, signal.SIGKILL)
    code = found.code()
    if code >= 0:  # it was just ending
        found.ended(code)
        return
    deadline_s = time.monotonic() + END_S
    while any(map(is_there, children)) and time.monotonic() < deadline_s:
        time.sleep(0.01)
    found.after_kills(1, gone=not any(map(is_there, children)))


def _kill_worker(found: Field, *, most: int) -> None:
    """Kills workers one after the other, until the command ends by itself."""
    pid, kills = found.begin(), 0
    while is_there(pid):
        time.sleep(found.rng.uniform(0.0, found.life_s / 2))
        workers = children_of(pid)
        if workers and kills + found.counts["kills"] < most:
            kills += _killed(found.rng.choice(workers))
    code, said = found.code(), found.said()
    is_told = code in (0, 1) or (code == 2 and AGAIN in said)
    found.after_kills(kills, told=is_told and "Traceback" not in said)
    if code == 2:  # it was the one that merges, or one whose part was just whole
        found.counts["again"] += 1
        found.begin()
        code = found.code()
    found.ended(code)


def _kill_merger(found: Field, ready: Path) -> None:
    parts = parts_folder(found.run)
    if not parts.exists():
        shutil.copytree(ready, parts)
    pid = found.begin()
    while is_there(pid) and not children_of(pid):
        time.sleep(LOOK_S)
    found.begun_s = time.monotonic()  # its life is that of the process that merges
    found.sleep()
    kills = sum(map(_killed, children_of(pid)))
    code = found.code()
    if code == 0:
        found.ended(code)
    else:
        is_told = code == 2 and f"{AGAIN} merges" in found.said()
        found.after_kills(max(kills, 1), told=is_told and kills == 1)


def _parts_ready(found: Field, ready: Path) -> Path:
    """A folder with all parts of the run, as they lie there when merging begins."""
    parts = parts_folder(found.run)
    for _ in range(BEGINNINGS):
        pid = found.begin()
        while len(list(parts.glob("parts/*.json"))) < EPISODES and is_there(pid):
            time.sleep(LOOK_S)
        os.kill(pid, signal.SIGKILL)
        found.code()
        if parts.exists() and not found.run.exists():
            shutil.copytree(parts, ready)
            shutil.rmtree(parts)
            return ready
        shutil.rmtree(found.run, ignore_errors=True)  # merged sooner than it could be stopped
    raise SystemExit(f"merged sooner than it could be stopped, {BEGINNINGS} times")


def _killed(pid: int) -> bool:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True
