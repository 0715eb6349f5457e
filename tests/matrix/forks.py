"""Tasks in forks of warm processes, one for each hash seed: importing is paid for once.

An audit plays once more in a process under another hash seed. Over all environments, starting that
process costs as much as the play; a fork has the hash seed, and nothing that an earlier task left.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, NoReturn

from gamekeeper.rollouts.pandas_later import pandas_can_wait
from gamekeeper.rollouts.workers import Status, TaskOutcome

LIMIT_S = 60
WARM = ("gamekeeper.auditing.elsewhere", "gamekeeper.auditing.set_order")


class Forks:
    """Stands in for `run_task`; the processes end with this one, as their input does."""

    def __init__(self) -> None:
        self._warm: dict[int, tuple[subprocess.Popen[bytes], IO[bytes]]] = {}

    def run_task(
        self, task: str, arguments: Mapping[str, Any], *, silence_s: float, hash_seed: int
    ) -> TaskOutcome:
        """What a task returned in a fork; a crash or a minute without an end is told as such."""
        process, answers = self._process(hash_seed)
        assert process.stdin is not None
        process.stdin.write(json.dumps([task, dict(arguments)]).encode() + b"\n")
        process.stdin.flush()
        value, told = json.loads(answers.readline())
        status: Status = "done" if told is None else "raised"
        return TaskOutcome(status, value, error=told, traceback=None, seconds=0.0)

    def _process(self, hash_seed: int) -> tuple[subprocess.Popen[bytes], IO[bytes]]:
        if hash_seed not in self._warm:
            here, there = os.pipe()
            process = subprocess.Popen(
                [sys.executable, "-P", "-B", str(Path(__file__)), str(there), *sys.path],
                stdin=subprocess.PIPE,
                stdout=2,  # what environments print goes where a worker's prints go
                pass_fds=[there],
                env={**os.environ, "PYTHONHASHSEED": str(hash_seed)},
            )
            os.close(there)
            self._warm[hash_seed] = (process, os.fdopen(here, "rb"))
        return self._warm[hash_seed]


def _perform(order: bytes, answers: int) -> NoReturn:
    """Runs one task in this fork and ends it."""
    signal.alarm(LIMIT_S)
    try:
        task, arguments = json.loads(order)
        module, _, name = task.partition(":")
        function = getattr(importlib.import_module(module), name)
        answer = [function(lambda **fields: None, **arguments), None]
    except BaseException:  # SystemExit of foreign code is data too
        answer = [None, traceback.format_exc()]
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
            told = [None, f"the fork ended with {os.waitstatus_to_exitcode(status)}"]
            os.write(answers, json.dumps(told).encode() + b"\n")


if __name__ == "__main__":
    main()
