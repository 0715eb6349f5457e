"""Commands over many workers: their executor, their parts, and the notes on them at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._screen import Screen
from gamekeeper.cli._worker import MEGABYTE, Recorded
from gamekeeper.rollouts.executors import executor_of
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import Limits
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.runs.parts.part_plan import is_free, parts_folder

if TYPE_CHECKING:
    from gamekeeper.runs.parts.fan_out import FanOut

LOCAL: Final = "local"


def is_fanned(workers: int | None, executor: str | None, storage: str | None) -> bool:
    """Tells if a command line asks for workers; without any of these options one process plays."""
    return (workers, executor, storage) != (None, None, None)


@contextmanager
def players_of(executor: str | None, workers: int, *, asked: int | None) -> Iterator[Any]:
    """Yields the number of local processes, or the executor that the user named.

    Args:
        executor: as the user named it; None: processes of this machine.
        workers: number of these.
        asked: number that the user asked for; None leaves it to another executor.
    Raises:
        GamekeeperError: there is no such executor.
    """
    if executor is None or executor == LOCAL:
        yield workers
        return
    with executor_of(executor, asked or None) as players:
        yield players


def free_for(plan: RolloutPlan, storage: str | None) -> Callable[[Path], bool]:
    """Returns a function that tells if a numbered folder can be this plan's."""
    return lambda out: storage is not None or is_free(Storage.at(parts_folder(out)), plan)


def record_by_workers(
    screen: Screen,
    plan: RolloutPlan,
    out: Path,
    *,
    workers: int | None,
    executor: str | None,
    storage: str | None,
    silence_s: float,
    memory_mb: int | None,
) -> Recorded:
    """Records by tasks of an executor; parts that are whole when it stops aren't played again.

    Raises:
        GamekeeperError: it couldn't begin, or a policy went wrong; an environment's own failure is
            in what is returned, as long as there is evidence of it.
        KeyboardInterrupt: by Ctrl-C.
    """
    from gamekeeper.runs.load_run import load
    from gamekeeper.runs.parts.fan_out import record_apart

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
        screen.error(
            f"interrupted: no run was written; the episodes played until now stay in {place}, and "
            "the same command continues from them"
        )
        raise
    _say(screen, played)
    return Recorded(load(out), played.error, depends=played.depends)


def _say(screen: Screen, played: FanOut) -> None:
    """Notes earlier and damaged parts, workers that died, and an episode that doesn't replay."""
    if played.found:
        screen.note(f"{played.found} of {played.parts} ranges of episodes were there already")
    if played.torn:
        many = "a range was" if played.torn == 1 else f"{played.torn} ranges were"
        screen.note(f"{many} damaged, as a power cut leaves them, and played again")
    if played.deaths:
        times = "once" if played.deaths == 1 else f"{played.deaths} times"
        screen.note(f"a worker process died {times}; what it played was played again")
    if played.note:
        screen.note(played.note)
