"""Audits of all faulty environments by two processes; a result is there once it is asked for.

A process audits many environments one after the other, so that importing is paid for once; what an
audit plays under another hash seed, it plays in a fork.
"""

from __future__ import annotations

import threading
from functools import cache
from typing import Any

from gamekeeper.auditing import confirm, elsewhere
from gamekeeper.auditing.audit import AuditAttempt, audit_here
from gamekeeper.auditing.result import AuditResult
from gamekeeper.rollouts.workers import run_task
from tests.faults import environments
from tests.matrix.forks import Forks

PROCESSES = 2
TRIES = 2
"""Fresh processes for each reproducer; an audit that isn't one of some hundred takes five."""
TASK = f"{__name__}:audit_task"
NAMES = list(environments())
CLEAN = [name for name, each in environments().items() if not each.checks]


def seen(name: str) -> AuditResult:
    """The audit of an environment, under its contract; waits until a process has made it."""
    return AuditResult.from_json(_pool().result(name)["audit"])


@cache
def _pool() -> _Pool:
    return _Pool()


class _Pool:
    """Processes that audit the environments; the clean ones first, as most tests ask for them."""

    def __init__(self) -> None:
        self._found: dict[str, Any] = {}
        self._news = threading.Condition()
        self._failed: list[str] = []
        order = [*CLEAN, *(name for name in NAMES if name not in CLEAN)]
        for start in range(PROCESSES):
            share = order[start::PROCESSES]
            threading.Thread(target=self._work, args=(share,), daemon=True).start()

    def result(self, name: str) -> Any:
        """What a process reported of an environment."""
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
    """Audits environments in this process; reproducers run in fresh ones."""
    elsewhere.run_task = Forks().run_task  # type: ignore[assignment]  # this process is for this alone
    confirm.TRIES = TRIES  # type: ignore[misc]  # this process is for this alone
    for name in names:
        each = environments()[name]
        audit = audit_here(
            each.spec, contract=each.contract, budget=each.budget, attempt=AuditAttempt(beat=report)
        )
        report(name=name, audit=audit.to_json())
