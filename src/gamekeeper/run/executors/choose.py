"""Executors by the names that users type: `local`, `ray`, `ray:ADDRESS`."""

from __future__ import annotations

from gamekeeper.errors import GamekeeperError
from gamekeeper.run.executors.task import Executor


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
    if workers is not None and workers < 1:
        raise GamekeeperError(
            "nobody would play", where="workers", expected="at least 1", seen=str(workers)
        )
    kind, _, address = text.partition(":")
    if kind == "local" and not address:
        from gamekeeper.run.executors.local import LocalExecutor

        return LocalExecutor(workers)
    if kind == "ray":
        from gamekeeper.run.executors.ray import RayExecutor

        return RayExecutor(address or None, workers)
    raise GamekeeperError(
        "there is no such executor",
        where="executor",
        expected="local, ray, ray:ADDRESS",
        seen=repr(text),
    )
