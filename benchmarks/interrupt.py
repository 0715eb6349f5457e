"""Ctrl-C at random instants of every long command: how it ends, and what it leaves behind.

Each command is begun in a fork of a process that has imported everything, so that the instants fall
into its work (`--cold`: in a process of its own, so that they fall into the imports too). After a
random part of its life it is interrupted. What must be so then:

    ended     within `END_S`, with 130 (or by the signal itself, while the process was ending), or
              with its own code where it was done already
    quiet     no traceback and no "fault of gamekeeper" was said
    gone      no process that it started is left
    openable  every run's folder can be read, or isn't there
    clean     no temporary file or draft lies about (parts of a run stay, as is said)

One JSON line a command: {"figure", "command", "instants", "life_s", "interrupted", "ended",
"quiet", "gone", "openable", "clean", "end_s_max"}. Exits 1 where a number falls short of
`instants`; what was said then goes to stderr.

    python benchmarks/interrupt.py [--command record] [--instants 20] [--seed 0] [--cold]
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

from gamekeeper.errors import GamekeeperError
from gamekeeper.interface.opening import open_env
from gamekeeper.runs.files.store import RunStore
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import record, rollout

TASK: Final = "two_robot_line"
END_S: Final = 60.0
"""How long an interrupted command may take: 10 s of grace for its task, times a busy machine."""
MARK: Final = "GAMEKEEPER_INTERRUPTED_BY"
COMMANDS: Final[dict[str, tuple[str, ...]]] = {
    "record": ("rollout", TASK, "--episodes", "60", "--out", "new"),
    "record-workers": ("rollout", TASK, "--episodes", "8", "--workers", "2", "--out", "new"),
    "run": ("run", TASK, "--episodes", "20", "--out", "new"),
    "replay": ("replay", "line"),
    "audit": ("audit", TASK, "--quick"),
    "diagnose": ("diagnose", "line", "--episodes", "200"),
    "attribute": ("attribute", "line", "--episodes", "2", "--action-episodes", "1"),
    "evaluate": (
        "evaluate",
        TASK,
        "--policy",
        "reference",
        "--policy",
        "random",
        "--episodes",
        "8",
        "--workers",
        "2",
        "--out",
        "evaluation",
    ),
    "report": ("report", "line", "--out", "report.html"),
    "query": ("query", "line", "select agent, sum(reward) from agent_steps group by agent"),
    "video": ("video", "warehouse", "--render", "--out", "film.gif"),
    "view": ("view", "line", "--no-browser"),
    "recover": ("recover", "torn"),
    "diff": ("diff", "line", "other"),
    "verify": ("verify", "line"),
    "export": ("export", "line", "--to", "numpy", "--out", "exported.npz"),
}
ENDLESS: Final = {"view": 3.0}
"""Commands that only Ctrl-C ends, with the part of their life that is looked at, in seconds."""
LEFT: Final = {"record-workers": {"new-parts"}}
"""What may lie about after an interrupt, beside the results."""
RESULTS: Final = ("new", "evaluation", "report.html", "film.gif", "exported.npz")
DRAFTS: Final = ("*.tmp", ".*.merging", "*.tmp.*", ".*.tmp*", "*.part")
FORKS: Final = """
import importlib, json, os, pkgutil, sys
import gamekeeper.cli._app
for package in sys.argv[1:]:
    for info in pkgutil.iter_modules(importlib.import_module(package).__path__, f"{package}."):
        importlib.import_module(info.name)
import gamekeeper.runs.parts.fan_out, gamekeeper.runs.load_run, gamekeeper.runs.run_check
from gamekeeper.cli import main

for line in sys.stdin:
    pid = os.fork()
    if not pid:
        arguments, folder, said, mark = json.loads(line)
        os.environ[mark[0]] = mark[1]
        os.chdir(folder)
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
        os.dup2(1, 2)
        sys.stdin = open(os.devnull)
        sys.exit(main(arguments))
    print(pid, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""


@dataclass(slots=True)
class Bench:
    """Where commands run: a folder that is made anew for each, and what starts them."""

    forks: subprocess.Popen[str] | None
    base: Path
    rng: random.Random
    number: int = 0

    @property
    def said(self) -> str:
        """What the last command said."""
        return (self.base / "said").read_text(encoding="utf-8", errors="replace")

    def run(self, words: tuple[str, ...], *, after_s: float | None) -> tuple[int, float, float]:
        """Runs a command in a fresh folder, interrupted after so long; code, life, end (s)."""
        shutil.rmtree(self.base / "work", ignore_errors=True)
        shutil.copytree(self.base / "ready", self.base / "work")
        self.number += 1
        start_s = time.monotonic()
        process = _Forked(self, words) if self.forks else _Cold(self, words)
        if after_s is not None:
            process.wait(after_s)
        told_s = time.monotonic()
        if after_s is not None and process.is_there():
            os.kill(process.pid, signal.SIGINT)
        code = process.code(END_S if after_s is not None else None)
        return code, time.monotonic() - start_s, time.monotonic() - told_s

    def mark(self) -> tuple[str, str]:
        """What every process that the current command starts has in its environment."""
        return MARK, f"{os.getpid()}-{self.number}"


class _Forked:
    """A command in a fork of a process that has imported everything."""

    def __init__(self, bench: Bench, words: tuple[str, ...]) -> None:
        forks = bench.forks
        assert forks is not None
        assert forks.stdin is not None
        assert forks.stdout is not None
        order = [words, str(bench.base / "work"), str(bench.base / "said"), bench.mark()]
        forks.stdin.write(json.dumps(order) + "\n")
        forks.stdin.flush()
        self._out = forks.stdout
        self.pid = int(self._out.readline())

    def is_there(self) -> bool:
        return _is_there(self.pid)

    def wait(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while self.is_there() and time.monotonic() < end_s:
            time.sleep(min(0.005, max(0.0, end_s - time.monotonic())))

    def code(self, most_s: float | None) -> int:
        if most_s is not None:
            self.wait(most_s)
            if self.is_there():
                os.kill(self.pid, signal.SIGKILL)
        return int(self._out.readline())


class _Cold:
    """A command in a process of its own, as a shell starts it."""

    def __init__(self, bench: Bench, words: tuple[str, ...]) -> None:
        with (bench.base / "said").open("wb") as said:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "gamekeeper", *words],
                cwd=bench.base / "work",
                env={**os.environ, "PYTHONPATH": _path(), **dict([bench.mark()])},
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
            )
        self.pid = self._process.pid

    def is_there(self) -> bool:
        return self._process.poll() is None

    def wait(self, seconds: float) -> None:
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return

    def code(self, most_s: float | None) -> int:
        try:
            return self._process.wait(most_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


def main() -> int:
    """Interrupts as often as asked for; 1 if anything wasn't as it should be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--command", action="append", choices=list(COMMANDS))
    parser.add_argument("--instants", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cold", action="store_true")
    given = parser.parse_args()
    is_clean = True
    with bench(seed=given.seed, is_cold=given.cold) as made:
        for name in given.command or COMMANDS:
            figures = interrupted(made, name, instants=given.instants)
            print(json.dumps(figures), flush=True)
            is_clean = is_clean and is_whole(figures)
    return 0 if is_clean else 1


@contextmanager
def bench(*, seed: int, is_cold: bool = False) -> Iterator[Bench]:
    """A bench with runs to work on; everything is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="interrupt-") as folder, patch.dict(os.environ):
        base = Path(folder)
        (base / "tmp").mkdir()
        # pyarrow imports pandas where there is one, which takes longer than all the rest
        (base / "without").mkdir()
        (base / "without" / "pandas.py").write_text("raise ImportError", encoding="utf-8")
        _make_ready(base / "ready")
        os.environ["TMPDIR"] = str(base / "tmp")
        if is_cold:
            yield Bench(None, base, random.Random(seed))
            return
        environment = {**os.environ, "PYTHONPATH": f"{base / 'without'}{os.pathsep}{_path()}"}
        with subprocess.Popen(
            [sys.executable, "-c", FORKS, "gamekeeper.cli"],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as forks:
            yield Bench(forks, base, random.Random(seed))


def _make_ready(folder: Path) -> None:
    """The runs that commands work on."""
    rollout(TASK, episodes=20, seed=0, out=folder / "line")
    rollout(TASK, episodes=20, seed=1, out=folder / "other")
    rollout("warehouse", episodes=1, seed=0, out=folder / "warehouse", most_turns=40)
    with patch.object(RunStore, "finalize", lambda self, manifest: self.abandon()):
        env = record(open_env(TASK).env, folder / "torn")
        for seed in range(100):
            env.reset(seed=seed)
        env.close()


def interrupted(
    made: Bench, name: str, *, instants: int, life_s: float | None = None
) -> dict[str, Any]:
    """The figures of one command.

    Args:
        life_s: how much of its life is looked at; None: all of it, which is measured first.
    """
    words, counts, ends = COMMANDS[name], Counter[str](), []
    results, codes = set(RESULTS), {130, -signal.SIGINT}
    if name in ENDLESS:
        life_s, codes = ENDLESS[name], codes | {0}
    elif life_s is None:
        code, life_s, _ = made.run(words, after_s=None)
        codes.add(code)
        results |= _names(made.base / "work")
    else:
        codes |= {0, 1}
    for _ in range(instants):
        code, _, end_s = made.run(words, after_s=made.rng.uniform(0.0, life_s))
        ends.append(end_s)
        claims = {
            "ended": code in codes,
            "quiet": "Traceback" not in made.said and "fault of gamekeeper" not in made.said,
            "gone": not _left(made.mark()),
            "openable": all(map(_is_openable, (made.base / "work").iterdir())),
            "clean": not _strays(made.base, results | LEFT.get(name, set())),
        }
        counts["interrupted"] += code == 130
        counts.update({claim: int(holds) for claim, holds in claims.items()})
        broken = [claim for claim, holds in claims.items() if not holds]
        if broken:
            strays = _strays(made.base, results | LEFT.get(name, set()))
            sys.stderr.write(f"{name}: not {broken}, code {code}, {strays}\n{made.said}\n")
    return {
        "figure": "interrupt",
        "command": name,
        "instants": instants,
        "life_s": round(life_s, 2),
        **counts,
        "end_s_max": round(max(ends), 2),
    }


def is_whole(figures: dict[str, Any]) -> bool:
    """Whether nothing fell short."""
    claims = ("ended", "quiet", "gone", "openable", "clean")
    return all(figures.get(claim, 0) == figures["instants"] for claim in claims)


def _is_openable(path: Path) -> bool:
    if not (path / "manifest.json").exists():
        return True
    try:
        load(path)
    except GamekeeperError as error:
        sys.stderr.write(f"{error}\n")
        return False
    return True


def _strays(base: Path, known: set[str]) -> list[str]:
    """What lies about and shouldn't: temporary files, and drafts beside the results."""
    work = base / "work"
    ready = _names(base / "ready")
    found = [str(path) for path in (base / "tmp").iterdir()]
    found += sorted(_names(work) - ready - known)
    for path in work.iterdir():
        is_open = path.is_dir() and _status(path) == "open"
        if path.name in known | {"torn"} and (is_open or path.name.endswith("-parts")):
            continue  # what an open run holds is what `recover` takes
        found += [str(p.relative_to(work)) for draft in DRAFTS for p in path.rglob(draft)]
    return found


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def _status(path: Path) -> str:
    try:
        return str(json.loads((path / "manifest.json").read_text(encoding="utf-8"))["status"])
    except (OSError, ValueError, KeyError):
        return "none"


def _left(mark: tuple[str, str]) -> list[int]:
    """Processes of the command that are still there, a moment later."""
    wanted, deadline_s = "=".join(mark).encode(), time.monotonic() + 5.0
    while (found := _marked(wanted)) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    return found


def _marked(wanted: bytes) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if wanted in path.read_bytes().split(b"\0"):
                found.append(int(path.parent.name))
        except OSError:  # gone meanwhile, or somebody else's
            continue
    return [pid for pid in found if _is_there(pid)]


def _is_there(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _path() -> str:
    return os.pathsep.join(filter(None, sys.path))


if __name__ == "__main__":
    sys.exit(main())
