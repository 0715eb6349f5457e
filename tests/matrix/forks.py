"""Tasks in forks of warm processes: importing is paid for once.

An audit plays once more in a process under another hash seed, and runs its reproducers in fresh
processes. Over all environments, starting those costs as much as the play; a fork has the hash
seed, and nothing that an earlier task left.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import traceback
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NoReturn

from gamekeeper.rollouts.pandas_later import pandas_can_wait
from gamekeeper.rollouts.workers import TaskOutcome

LIMIT_S = 60
WARM = (
    "gamekeeper.auditing.elsewhere",
    "gamekeeper.auditing.reproducer_process",
    "gamekeeper.auditing.set_order",
)


@dataclass(frozen=True, slots=True)
class WarmProcess:
    """A process that forks for each task, one after the other; it ends as its input does."""

    process: subprocess.Popen[bytes]
    answers: IO[bytes]

    def outcome(self, task: str, arguments: Mapping[str, Any]) -> TaskOutcome:
        """Result of a task in a fork."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps([task, dict(arguments)]).encode() + b"\n")
        self.process.stdin.flush()
        status, value, error = json.loads(self.answers.readline())
        return TaskOutcome(status, value, error=error, traceback=None, seconds=0.0)


class Forks:
    """Stands in for `run_task`.

    Tasks that run beside each other have warm processes of their own, under hash seeds of their own
    where none is asked for.
    """

    def __init__(self) -> None:
        self._idle: defaultdict[int | None, list[WarmProcess]] = defaultdict(list)

    def run_task(
        self, task: str, arguments: Mapping[str, Any], *, hash_seed: int | None = None, **_: Any
    ) -> TaskOutcome:
        """Result of a task in a fork, which is killed after a minute."""
        idle = self._idle[hash_seed]
        warm = idle.pop() if idle else _started(hash_seed)
        outcome = warm.outcome(task, arguments)
        idle.append(warm)
        return outcome


def _started(hash_seed: int | None) -> WarmProcess:
    here, there = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-P", "-B", str(Path(__file__)), str(there), *sys.path],
        stdin=subprocess.PIPE,
        stdout=2,  # what environments print goes where a worker's prints go
        pass_fds=[there],
        env=os.environ | ({} if hash_seed is None else {"PYTHONHASHSEED": str(hash_seed)}),
    )
    os.close(there)
    return WarmProcess(process, os.fdopen(here, "rb"))


def _perform(order: bytes, answers: int) -> NoReturn:
    """Runs one task in this fork and ends it."""
    signal.alarm(LIMIT_S)
    try:
        task, arguments = json.loads(order)
        module, _, name = task.partition(":")
        function = getattr(importlib.import_module(module), name)
        answer = ["done", function(lambda **fields: None, **arguments), None]
    except BaseException:  # SystemExit of foreign code is data too
        answer = ["raised", None, traceback.format_exc()]
    os.write(answers, json.dumps(answer).encode() + b"\n")
    os._exit(0)


def main() -> None:
    """Imports what tasks need, then forks for each line that comes in."""
    answers = int(sys.argv[1])
    os.set_inheritable(answers, False)
    sys.path[:] = sys.argv[2:]
    pandas_can_wait()
    for name in WARM:
        importlib.import_module(name)
    for order in sys.stdin.buffer:
        child = os.fork()
        if not child:
            _perform(order, answers)
        _, status = os.waitpid(child, 0)
        if status:
            code = os.waitstatus_to_exitcode(status)
            ended = "hung" if code == -signal.SIGALRM else "died"
            answer = [ended, None, f"the fork ended with {code}"]
            os.write(answers, json.dumps(answer).encode() + b"\n")


if __name__ == "__main__":
    main()
