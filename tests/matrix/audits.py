"""Audits of all faulty environments, each made once by two processes and kept for all readers.

A process audits many environments one after the other, so that importing is paid for once; what an
audit plays or shows in other processes, it does in forks of processes that serve all audits. An
audit is kept in `build/audits`, under a digest of all that it depends on: both tiers of the tests
and the pages of the checks read the same one.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import threading
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.auditing import confirm
from gamekeeper.auditing.audit import AuditAttempt, audit_here
from gamekeeper.auditing.result import AuditResult
from gamekeeper.rollouts.workers import run_task
from tests.auditing.kept_workers import keep_workers
from tests.faults import environments

PROCESSES = 2
TRIES = 2
"""Fresh processes for each reproducer; an audit that isn't one of some hundred takes five."""
TASK = f"{__name__}:audit_task"
ROOT = Path(__file__).parents[2]
SOURCES = (
    "src/gamekeeper",
    "tests/faults",
    "tests/matrix",
    "tests/auditing/kept_workers.py",
    "requirements/test.txt",
)
"""Files and folders that an audit depends on."""
NAMES = list(environments())
CLEAN = [name for name, each in environments().items() if not each.checks]


def seen(name: str) -> AuditResult:
    """The audit of an environment, under its contract; waits until a process has made it."""
    return AuditResult.from_json(document(name))


def document(name: str) -> dict[str, Any]:
    """The same as plain data."""
    return _pool().result(name)


def ask(names: list[str]) -> None:
    """Has these audits made in the background, in this order."""
    _pool().ask(names)


@cache
def _pool() -> _Pool:
    return _Pool()


@cache
def _folder() -> Path:
    """The folder of the audits that these sources and packages give."""
    digest = hashlib.blake2b(sys.version.encode(), digest_size=16)
    for source in SOURCES:
        path = ROOT / source
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.suffix in (".py", ".toml", ".txt"):
                digest.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    return ROOT / "build" / "audits" / digest.hexdigest()


class _Pool:
    """Processes that make the audits which were asked for and aren't kept yet."""

    def __init__(self) -> None:
        self._asked: set[str] = set()
        self._found: dict[str, dict[str, Any]] = {}
        self._news = threading.Condition()
        self._failed: list[str] = []

    def ask(self, names: list[str]) -> None:
        """Has what nobody asked for yet made by two processes; a single one by one."""
        fresh = [name for name in dict.fromkeys(names) if name not in self._asked]
        self._asked.update(fresh)
        for start in range(min(PROCESSES, len(fresh))):
            share = fresh[start::PROCESSES]
            threading.Thread(target=self._work, args=(share,), daemon=True).start()

    def result(self, name: str) -> dict[str, Any]:
        """The document of an audit."""
        self.ask([name])
        with self._news:
            self._news.wait_for(lambda: name in self._found or self._failed)
        if name not in self._found:
            raise RuntimeError(self._failed[0])
        return self._found[name]

    def _work(self, names: list[str]) -> None:
        kept = {name: _kept(name) for name in names}
        for name, audit in kept.items():
            if audit is not None:
                self._take({"name": name, "audit": audit})
        missing = [name for name, audit in kept.items() if audit is None]
        if not missing:
            return
        outcome = run_task(TASK, {"names": missing}, silence_s=300.0, on_message=self._take)
        if outcome.status != "done":
            with self._news:
                self._failed.append(f"{outcome.status}: {outcome.error}\n{outcome.traceback}")
                self._news.notify_all()

    def _take(self, message: dict[str, Any]) -> None:
        if "name" in message:
            with self._news:
                self._found[message["name"]] = message["audit"]
                self._news.notify_all()


def _kept(name: str) -> dict[str, Any] | None:
    path = _folder() / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def _keep(name: str, audit: dict[str, Any]) -> None:
    _folder().mkdir(parents=True, exist_ok=True)
    path = _folder() / f"{name}.json"
    part = path.with_suffix(f".{os.getpid()}")
    part.write_text(json.dumps(audit), encoding="utf-8")
    part.replace(path)


def audit_task(report: Any, *, names: list[str]) -> None:
    """Audits environments in this process, which is for this alone."""
    patch = pytest.MonkeyPatch()
    keep_workers(patch)
    patch.setattr(confirm, "TRIES", TRIES)
    for name in names:
        each = environments()[name]
        audit = audit_here(
            each.spec,
            contract=each.contract,
            budget=each.budget,
            select=("GK",),  # every check, without the measured form
            attempt=AuditAttempt(beat=report),
        ).to_json()
        _keep(name, audit)
        report(name=name, audit=audit)
