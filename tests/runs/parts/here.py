"""Executors that play in this process, and recordings by them."""

from __future__ import annotations

import importlib
import json
import os
import random
import signal
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import USUAL, Done, Limits, OnReport, WorkTask
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.rollouts.workers import TaskOutcome
from gamekeeper.runs.parts import fan_out as apart
from gamekeeper.runs.parts import fan_out as playing
from gamekeeper.runs.parts.fan_out import FanOut, record_apart
from gamekeeper.runs.parts.part_plan import parts_folder

CROWD = f"{Path(__file__).with_name('crowd.py')}:Crowd"


def called(call: str, arguments: Any, report: Any = None) -> TaskOutcome:
    """How a task ends that is played here; what crosses is JSON, as to a process."""
    module, _, name = call.partition(":")
    function = getattr(importlib.import_module(module), name)
    value = function(report or (lambda **fields: None), **json.loads(json.dumps(arguments)))
    return TaskOutcome("done", json.loads(json.dumps(value)), None, None, 0.0)


class Here:
    """Plays tasks in this process, a few in flight at a time and in any order.

    Args:
        order: settles the order; None: as they come.
        stop: how many are played before Ctrl-C comes.
        most: how many are in flight.
    """

    workers = 1

    def __init__(self, order: int | None = None, stop: int | None = None, most: int = 4) -> None:
        self.played: list[str] = []
        self._rng = None if order is None else random.Random(order)
        self._stop, self._most = stop, most

    def __enter__(self) -> Here:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """There is nothing to let go of."""

    def check_storage(self, place: str) -> None:
        """It is this process that looks."""

    def map(
        self,
        tasks: Iterable[WorkTask],
        *,
        limits: Limits = USUAL,
        on_report: OnReport | None = None,
    ) -> Iterator[Done]:
        """Yields each task as it ends."""
        source = iter(tasks)
        flight = list(islice(source, self._most))
        while flight:
            task = flight.pop(0 if self._rng is None else self._rng.randrange(len(flight)))
            if self._stop is not None and len(self.played) >= self._stop:
                raise KeyboardInterrupt
            self.played.append(task.key)

            def report(key: str = task.key, **fields: Any) -> None:
                if on_report is not None and fields:
                    on_report(key, fields)

            yield Done(task.key, called(task.call, task.arguments, report))
            flight += islice(source, self._most - len(flight))


@pytest.fixture
def tasks_run_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Merging needs no process of its own either."""

    def run(call: str, arguments: Any, **options: Any) -> TaskOutcome:
        return called(call, arguments)

    for module in (apart, playing):
        monkeypatch.setattr(module, "run_task", run)


def die(report: Any, **arguments: Any) -> None:
    """A task that doesn't come to its end."""
    os.kill(os.getpid(), signal.SIGKILL)


def plan(**changed: Any) -> RolloutPlan:
    """Six episodes of the crowd."""
    usual: dict[str, Any] = {"spec": CROWD, "episodes": 6, "seed": 3}
    return RolloutPlan(**{**usual, **changed})


def apart_into(
    out: Path, wanted: RolloutPlan, executor: Here | None = None, storage: Storage | None = None
) -> FanOut:
    """A plan recorded by tasks."""
    place = Storage.at(parts_folder(out)) if storage is None else storage
    return record_apart(wanted, out, executor=executor or Here(), storage=place)
