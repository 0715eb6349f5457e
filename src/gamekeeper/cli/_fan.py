"""Commands over many workers: who plays, where parts go, and what is said of it at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import typer

from gamekeeper.cli._options import MOST_WORKERS
from gamekeeper.cli._screen import Screen
from gamekeeper.cli._worker import MEGABYTE, Plan, Recorded
from gamekeeper.record.parts.plan import is_free, parts_folder
from gamekeeper.run.executors.choose import executor_of
from gamekeeper.run.executors.storage import Storage
from gamekeeper.run.executors.task import Limits

if TYPE_CHECKING:
    from gamekeeper.record.parts.apart import Apart

LOCAL: Final = "local"

FanOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--workers", metavar="N", min=1, max=MOST_WORKERS, show_default=False,
        help="Processes that play side by side; the result is the same for any number.",
    ),
]  # fmt: skip
ExecutorOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--executor", metavar="NAME", show_default=False,
        help="Who plays: local (processes of this machine), ray, ray:ADDRESS.",
    ),
]  # fmt: skip
StorageOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--storage", metavar="PLACE", show_default=False,
        help="Where workers put their parts: a folder that all reach, or a URL (s3://, gs://); "
        "otherwise RUN-parts.",
    ),
]  # fmt: skip


def is_fanned(workers: int | None, executor: str | None, storage: str | None) -> bool:
    """Whether a command line asks for workers; without any of these options one process plays."""
    return (workers, executor, storage) != (None, None, None)


@contextmanager
def players_of(executor: str | None, workers: int, *, asked: int | None) -> Iterator[Any]:
    """Who plays, for what takes a number of processes or an executor.

    Args:
        executor: as the user named it; None: processes of this machine.
        workers: how many of these.
        asked: how many the user asked for; None leaves it to another executor.
    Raises:
        GamekeeperError: there is no such executor.
    """
    if executor is None or executor == LOCAL:
        yield workers
        return
    with executor_of(executor, asked or None) as players:
        yield players


def free_for(plan: Plan, storage: str | None) -> Callable[[Path], bool]:
    """Tells of a folder that nobody named whether it can be this plan's."""
    return lambda out: storage is not None or is_free(Storage.at(parts_folder(out)), plan)


def record_by_workers(
    screen: Screen,
    plan: Plan,
    out: Path,
    *,
    workers: int | None,
    executor: str | None,
    storage: str | None,
    silence_s: float,
    memory_mb: int | None,
) -> Recorded:
    """Records by tasks of an executor; what is whole when it is stopped isn't played again.

    Raises:
        GamekeeperError: it couldn't begin, or a policy went wrong; an environment's own failure is
            in what is returned, as long as there is evidence of it.
        KeyboardInterrupt: by Ctrl-C.
    """
    from gamekeeper.record.bundle import load
    from gamekeeper.record.parts.apart import record_apart

    place = Storage.at(parts_folder(out) if storage is None else storage)
    memory_bytes = None if memory_mb is None else memory_mb * MEGABYTE
    limits = Limits(silence_s=silence_s, memory_bytes=memory_bytes)
    try:
        with (
            executor_of(executor or LOCAL, workers) as players,
            screen.progress("recording") as take,
        ):
            played = record_apart(
                plan, out, executor=players, storage=place, limits=limits, on_message=take
            )
    except KeyboardInterrupt:
        screen.note(f"the parts that are whole lie in {place}; the same command goes on from them")
        raise
    _say(screen, played)
    return Recorded(load(out), played.error)


def _say(screen: Screen, played: Apart) -> None:
    """Says what of the parts isn't in the evidence: those found, and deaths on the way."""
    if played.found:
        screen.note(f"{played.found} of {played.parts} parts were there already")
    if played.torn:
        many = "a part was" if played.torn == 1 else f"{played.torn} parts were"
        screen.note(f"{many} damaged, as a power cut leaves them, and played again")
    if played.deaths:
        times = "once" if played.deaths == 1 else f"{played.deaths} times"
        screen.note(f"a worker process died {times}; what it played was played again")
