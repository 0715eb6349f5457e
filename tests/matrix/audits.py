"""Audits of all specimens by two processes side by side; a result is there once it is asked for.

A process audits many specimens one after the other, so that importing is paid for once; what an
audit plays under another hash seed, it plays in a fork.
"""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys
import threading
from dataclasses import dataclass
from functools import cache
from typing import Any

from gamekeeper.audit import elsewhere, specimens
from gamekeeper.audit.audit import audit_here
from gamekeeper.audit.result import Audit
from gamekeeper.core.contract import Contract
from gamekeeper.run.workers import run_task
from tests.matrix.forks import Forks

BUDGET = 2_000
MORE = {"gk831_history_in_bytes": 4_000, "gk831_history_in_lines": 4_000}
"""Budgets of specimens whose fault shows late."""
PROCESSES = 2
TASK = f"{__name__}:audit_task"
NAMES = [
    info.name for info in pkgutil.iter_modules(specimens.__path__) if not info.name.startswith("_")
]
CLEAN = [name for name in NAMES if name.startswith("clean_")]


@dataclass(frozen=True, slots=True)
class Seen:
    """What one specimen came to.

    Attributes:
        audit: under the contract that its module declares.
        program: the first finding's, of the first check that it is there to break; None where
            nothing is broken.
        code: that program's exit code.
        errors: what it wrote to stderr.
    """

    audit: Audit
    program: str | None
    code: int | None
    errors: str


def module_of(name: str) -> Any:
    """The specimen's module."""
    return importlib.import_module(f"{specimens.__name__}.{name}")


def seen(name: str) -> Seen:
    """What a specimen came to; waits until a process has audited it."""
    found = _pool().result(name)
    return Seen(Audit.from_json(found["audit"]), found["program"], found["code"], found["errors"])


@cache
def _pool() -> _Pool:
    return _Pool()


class _Pool:
    """Processes that audit the specimens; the clean ones first, as most tests ask for them."""

    def __init__(self) -> None:
        self._found: dict[str, Any] = {}
        self._news = threading.Condition()
        self._failed: list[str] = []
        order = [*CLEAN, *(name for name in NAMES if name not in CLEAN)]
        for start in range(PROCESSES):
            share = order[start::PROCESSES]
            threading.Thread(target=self._work, args=(share,), daemon=True).start()

    def result(self, name: str) -> Any:
        """What a process reported of a specimen."""
        with self._news:
            self._news.wait_for(lambda: name in self._found or self._failed)
        if name not in self._found:
            raise RuntimeError(self._failed[0])
        return self._found[name]

    def _work(self, names: list[str]) -> None:
        outcome = run_task(TASK, {"names": names}, silence_s=300.0, on_message=self._take)
        if outcome.status != "done":
            with self._news:
                self._failed.append(f"{outcome.status}: {outcome.error}\n{outcome.traceback}")
                self._news.notify_all()

    def _take(self, message: dict[str, Any]) -> None:
        if "name" in message:
            with self._news:
                self._found[message["name"]] = message
                self._news.notify_all()


def audit_task(report: Any, *, names: list[str]) -> None:
    """Audits specimens in this process and runs the program of the first finding of each."""
    elsewhere.run_task = Forks().run_task  # type: ignore[assignment]  # this process is for this alone
    for name in names:
        module = module_of(name)
        contract = getattr(module, "CONTRACT", None)
        audit = audit_here(
            f"{module.__name__}:make",
            contract=None if contract is None else Contract.from_json(contract),
            budget=MORE.get(name, BUDGET),
            beat=report,
        )
        program = next(
            (v.findings[0].reproduce for v in audit.broken if v.id in module.BREAKS), None
        )
        done = None if program is None else _run(program)
        report(
            name=name,
            audit=audit.to_json(),
            program=program,
            code=None if done is None else done.returncode,
            errors="" if done is None else done.stderr,
        )


def _run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
