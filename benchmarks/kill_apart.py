"""What a recording by workers loses by kill -9 of one of its processes, at random instants.

`gamekeeper record two_robot_line --workers 2` is a parent, two workers that play parts, and at the
end a process that merges them. One of them is killed at a random instant of the command's life, and
the same command is given again, until it ends by itself. What must be so then:

    gone      no process of a killed parent is left, within `END_S`
    untorn    where the run's folder should be lies nothing yet, or all of it, sealed
    told      of a killed worker or merger: the command ends with 0 or says what died, no traceback
    same      the fingerprint is the one of a single process that nobody killed
    clean     beside the run's folder lies nothing: no parts, no draft

A worker that is killed three times at one part ends the run as failed, as it should ("given_up").
Used by `benchmarks/kill.py --who parent|worker|merger`.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from gamekeeper.record.bundle import load
from gamekeeper.record.parts.plan import parts_folder
from gamekeeper.record.recording import rollout
from gamekeeper.record.verify import verify

WHO: Final = ("parent", "worker", "merger")
TASK: Final = "two_robot_line"
EPISODES: Final = 8
END_S: Final = 30.0
"""How long the processes of a killed parent may take to be gone."""
FIRST_LIFE_S: Final = 2.0
COMMANDS: Final = """
import json, os, sys
import gamekeeper.cli._app, gamekeeper.cli.record, gamekeeper.cli._fan
import gamekeeper.record.parts.apart, gamekeeper.record.bundle
from gamekeeper.cli import main

for line in sys.stdin:
    pid = os.fork()  # what takes longest, importing, was done once for all
    if not pid:
        arguments, said = json.loads(line)
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
        os.dup2(1, 2)
        sys.stdin = open(os.devnull)
        code = main(arguments)
        sys.stdout.flush(), sys.stderr.flush()
        os._exit(code)
    print(pid, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""


@dataclass(slots=True)
class Field:
    """One run's folder, the command that records it, and what was seen so far."""

    start: subprocess.Popen[str]
    folder: Path
    wanted: str
    rng: random.Random
    life_s: float = FIRST_LIFE_S
    begun_s: float = 0.0
    counts: Counter[str] = field(default_factory=Counter)

    @property
    def run(self) -> Path:
        """Where the evidence comes to lie."""
        return self.folder / "run"

    def begin(self) -> int:
        """The command begins; its process."""
        assert self.start.stdin is not None
        assert self.start.stdout is not None
        line = ["record", TASK, "--episodes", str(EPISODES), "--workers", "2", "--quiet"]
        self.start.stdin.write(
            json.dumps([[*line, "--out", str(self.run)], str(self.folder / "said")]) + "\n"
        )
        self.start.stdin.flush()
        self.begun_s = time.monotonic()
        return int(self.start.stdout.readline())

    def code(self) -> int:
        """Waits for the command's end; its exit code."""
        assert self.start.stdout is not None
        return int(self.start.stdout.readline())

    def sleep(self) -> None:
        """Until a random instant of the command's life."""
        time.sleep(self.rng.uniform(0.0, self.life_s))

    def seen(self, **claims: bool) -> None:
        """Counts the claims that hold, and shows what was said where one doesn't."""
        for name, holds in claims.items():
            self.counts[name] += holds
            if not holds:
                said = (self.folder / "said").read_text(encoding="utf-8", errors="replace")
                sys.stderr.write(f"not {name}: {said}\n")

    def after_kill(self, **claims: bool) -> None:
        """What has to be so after every kill."""
        is_there = self.run.exists() and any(self.run.iterdir())
        self.counts["kills"] += 1
        self.seen(untorn=not is_there or verify(self.run).ok, **claims)

    def ended(self, code: int) -> None:
        """What has to be so when the command has ended by itself."""
        self.counts["ends"] += 1
        evidence = load(self.run)
        if code == 1 and evidence.manifest["status"] == "failed":
            self.counts["given_up"] += 1
            self.seen(same=True, told="died" in self.said() or "killed" in self.said())
        else:
            self.life_s = 0.5 * self.life_s + 0.5 * (time.monotonic() - self.begun_s)
            self.seen(same=code == 0 and evidence.fingerprint == self.wanted)
        self.seen(clean={path.name for path in self.folder.iterdir()} == {"run", "said"})
        shutil.rmtree(self.run)

    def said(self) -> str:
        """What the last command said."""
        return (self.folder / "said").read_text(encoding="utf-8", errors="replace")


def kill(who: str, folder: Path, *, kills: int, rng: random.Random) -> tuple[dict[str, Any], bool]:
    """The figures of so many kills, and whether all was as it should be."""
    one = rollout(TASK, episodes=EPISODES, seed=0)
    with commands() as start:
        (folder / "field").mkdir()
        found = Field(start, folder / "field", one.fingerprint, rng)
        template = _parts_ready(found, folder / "ready") if who == "merger" else None
        while found.counts["kills"] < kills:
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
    is_whole = all(counts[name] >= counts["kills"] for name in each)
    is_whole = is_whole and counts["same"] == counts["clean"] == counts["ends"]
    return {"figure": "kill", "who": who, **counts}, is_whole


@contextmanager
def commands() -> Iterator[subprocess.Popen[str]]:
    """A process that forks a command for every line (its words, where its output goes)."""
    with subprocess.Popen(
        [sys.executable, "-c", COMMANDS], env={**os.environ, "PYTHONPATH": _path()},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        yield process


def _path() -> str:
    return os.pathsep.join(filter(None, sys.path))


def _kill_parent(found: Field) -> None:
    pid = found.begin()
    found.sleep()
    if not _is_there(pid):
        found.ended(found.code())
        return
    os.kill(pid, signal.SIGKILL)
    code = found.code()
    if code >= 0:  # it was just ending
        found.ended(code)
        return
    deadline_s = time.monotonic() + END_S
    while _workers_of(pid) and time.monotonic() < deadline_s:
        time.sleep(0.02)
    found.after_kill(gone=not _workers_of(pid))


def _kill_worker(found: Field, *, most: int) -> None:
    """Kills workers one after the other, until the command ends by itself."""
    pid, kills = found.begin(), 0
    while _is_there(pid):
        time.sleep(found.rng.uniform(0.1, found.life_s / 2))
        workers = _workers_of(pid)
        if workers and kills + found.counts["kills"] < most:
            try:
                os.kill(found.rng.choice(workers), signal.SIGKILL)
            except ProcessLookupError:
                continue
            kills += 1
    code = found.code()
    if code not in (0, 1) and not found.run.exists():  # it was the one that merges
        for _ in range(kills):
            found.after_kill(told=code == 2 and "the same command merges" in found.said())
        found.begin()
        code, kills = found.code(), 0
    for _ in range(kills):
        found.after_kill(told=code in (0, 1) and "Traceback" not in found.said())
    found.ended(code)


def _kill_merger(found: Field, ready: Path) -> None:
    parts = parts_folder(found.run)
    if not parts.exists():
        shutil.copytree(ready, parts)
    pid = found.begin()
    found.sleep()
    killed = [worker for worker in _workers_of(pid) if _killed(worker)]
    code = found.code()
    if code == 0:
        found.ended(code)
    elif killed:
        found.after_kill(told=code == 2 and "the same command merges" in found.said())


def _parts_ready(found: Field, ready: Path) -> Path:
    """A folder with all parts of the run, as they lie there when merging begins."""
    pid = found.begin()
    parts = parts_folder(found.run) / "parts"
    while len(list(parts.glob("*.json"))) < EPISODES:
        time.sleep(0.002)
        if not _is_there(pid):
            raise SystemExit("merged sooner than it could be stopped")
    os.kill(pid, signal.SIGKILL)
    found.code()
    shutil.copytree(parts_folder(found.run), ready)
    shutil.rmtree(found.run, ignore_errors=True)
    return ready


def _killed(pid: int) -> bool:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def _is_there(pid: int) -> bool:
    """Whether the process runs; one that its parent hasn't reaped doesn't."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _workers_of(pid: int) -> list[int]:
    """The worker processes that this one started: their last argument is its number."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:  # gone meanwhile
            continue
        is_worker = any(word.endswith(b"worker_main.py") for word in words)
        if is_worker and words[-2] == str(pid).encode() and _is_there(int(path.parent.name)):
            found.append(int(path.parent.name))
    return sorted(found)
