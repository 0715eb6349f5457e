"""Executors: what plays many tasks, on this machine or on many, behind one `map`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.rollouts.executors.task import Executor


def executor_of(text: str = "local", workers: int | None = None) -> Executor:
    """The executor that `text` names.

    Args:
        text: `local` (processes of this machine), `ray` (a cluster of this machine's), or
            `ray:ADDRESS` (one that runs already; `ray:auto` finds it).
        workers: how many tasks are played at a time; None: as many as there are cores.
    Raises:
        DependencyError: Ray isn't installed.
        GamekeeperError: there is no such executor, or no such number of workers.
    """
    from gamekeeper.rollouts.executors.task import check_workers

    check_workers(workers)
    kind, _, address = text.partition(":")
    if kind == "local" and not address:
        from gamekeeper.rollouts.executors.local import LocalExecutor

        return LocalExecutor(workers)
    if kind == "ray":
        from gamekeeper.rollouts.executors.ray import RayExecutor

        return RayExecutor(address or None, workers)
    raise GamekeeperError(
        "there is no such executor",
        where="executor",
        expected="local, ray, ray:ADDRESS",
        actual=repr(text),
        fix="use local, ray, or ray:ADDRESS of a cluster's head",
    )
