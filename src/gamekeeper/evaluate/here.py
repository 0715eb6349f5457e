"""This process as an executor, for environments and policies that are objects in memory."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from typing import Any, Self

from gamekeeper.run.executors.task import USUAL, Done, Limits, OnReport, Task
from gamekeeper.run.watch import Outcome
from gamekeeper.run.worker_main import find


class Here:
    """Plays one task after the other in this process; what a task raises comes out."""

    @property
    def workers(self) -> int:
        """One."""
        return 1

    def map(
        self,
        tasks: Iterable[Task],
        *,
        limits: Limits = USUAL,
        on_report: OnReport | None = None,
    ) -> Iterator[Done]:
        """Yields each task as it ends; no limits are held."""
        del limits
        for task in tasks:
            begun_s = time.monotonic()
            value = find(task.call)(_Report(task.key, on_report), **task.arguments)
            yield Done(task.key, Outcome("done", value, None, None, time.monotonic() - begun_s))

    def check_storage(self, place: str) -> None:
        """Nothing: whoever plays is this process."""

    def close(self) -> None:
        """Nothing is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class _Report:
    def __init__(self, key: str, on_report: OnReport | None) -> None:
        self._key, self._on_report = key, on_report

    def __call__(self, /, **fields: Any) -> None:
        if fields and self._on_report is not None:
            self._on_report(self._key, fields)
