"""A recording played by workers, wherever they are: parts, then one bundle.

The bundle is the one that a single process would have recorded, as far as the environment begins
every episode afresh: each part has an environment of its own. Where an episode fails, those after
it don't count, as they would not have been played. What is whole already isn't played again; what
turns out to be damaged when it is merged, as after a power cut, is.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import BundleError, GamekeeperError
from gamekeeper.record.parts.merged import found_merged
from gamekeeper.record.parts.plan import Plan, claim, release
from gamekeeper.record.parts.playing import Playing
from gamekeeper.record.told import error_in
from gamekeeper.run.executors.local import LocalExecutor
from gamekeeper.run.executors.storage import Storage
from gamekeeper.run.executors.task import USUAL, Executor, Limits, Task, stopped_after
from gamekeeper.run.watch import Outcome
from gamekeeper.run.workers import run_task

MERGE: Final = "gamekeeper.record.parts.merge:merge_task"

OnMessage = Callable[[dict[str, Any]], None]


@dataclass(frozen=True, slots=True)
class Apart:
    """What became of a recording by workers.

    Attributes:
        error: of the first episode that failed; None where none did.
        parts: how many there are in the bundle.
        found: how many of them were there before.
        deaths: how often a worker process died, and its task was played again.
        torn: how many parts were damaged, and were played again.
    """

    error: GamekeeperError | None
    parts: int
    found: int
    deaths: int
    torn: int


def record_apart(
    plan: Plan,
    out: Path,
    *,
    executor: Executor,
    storage: Storage,
    limits: Limits = USUAL,
    on_message: OnMessage = lambda fields: None,
) -> Apart:
    """Records a plan into the bundle `out`, by tasks that write their parts to `storage`.

    Stopped at any moment (also by Ctrl-C), the parts that are whole stay, and the same call goes on
    from them. Once the bundle is sealed they are gone; stopped in between, the same call takes them
    away, and leaves the bundle as it is.

    Args:
        out: a folder that doesn't exist yet, or is empty, on this machine.
        executor: plays the parts; a process of this machine merges them, one of the executor's
            where it is local.
        limits: of each task.
        on_message: called with `episode`, `episodes`, `turns` of all parts together, and with
            `merged` and `parts` once all are played.

    Raises:
        BundleError: `out` or `storage` holds something else, or can't be written.
        GamekeeperError: nothing could be recorded, or a policy went wrong.
        WorkerFault: a task of ours is broken.
        KeyboardInterrupt: by Ctrl-C.
    """
    merged = found_merged(storage, plan, out)
    if merged is not None:
        release(storage)
        return Apart(merged.error, merged.parts, found=merged.parts, deaths=0, torn=0)
    _check_free(out)
    executor.check_storage(storage.place)
    playing = Playing(plan, storage, on_message)
    if claim(storage, plan):
        playing.look()
    found, torn = len(playing.whole), 0
    try:
        while True:
            answers = executor.map(playing.tasks(), limits=limits, on_report=playing.take)
            with stopped_after(answers) as ends:
                for done in ends:
                    playing.end(done)
            damaged, error = _merge(playing, executor, out)
            if error is None:
                break
            if torn or not damaged:  # damaged again: it is no power cut that does this
                raise error
            torn = len(damaged)
            playing.forget(damaged)
    except GamekeeperError:
        if not playing.whole:  # nothing to go on from: the mended command mustn't be refused
            release(storage)
        raise
    release(storage)
    parts = playing.kept()
    return Apart(
        playing.first_error(), parts, max(min(found, parts) - torn, 0), playing.deaths, torn
    )


def _merge(
    playing: Playing, executor: Executor, out: Path
) -> tuple[list[str], GamekeeperError | None]:
    """The parts become the bundle, in another process: no evidence comes through this one.

    Returns:
        What was in the way, and the keys of the parts that are damaged, if it was they.
    """
    told, parts, first = playing.ended_by(), playing.kept(), playing.first_error()
    ended = None
    if first is not None:
        from gamekeeper.record.tasks import error_fields

        ended = error_fields(first)

    def take(fields: dict[str, Any]) -> None:
        playing.on_message({"merged": fields["merged"], "parts": parts})

    arguments = {
        "storage": playing.storage.place, "plan": playing.plan.to_json(),
        "out": str(out.absolute()), "parts": parts, "error": told, "ended": ended,
    }  # fmt: skip
    outcome = _merged(executor, arguments, take)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    if outcome.status not in ("done", "raised"):  # it may have died with its work done
        is_done = found_merged(playing.storage, playing.plan, out) is not None
        return [], None if is_done else _unmerged(outcome.error)
    error, value = error_in(outcome), outcome.value
    return (value["torn"] if isinstance(value, dict) else []), error


def _merged(executor: Executor, arguments: dict[str, Any], take: OnMessage) -> Outcome:
    """How merging ended, by a process of this machine; one that played has imported it all."""
    if not isinstance(executor, LocalExecutor):
        return run_task(MERGE, arguments, silence_s=None, on_message=take)
    limits = Limits(silence_s=None, attempts=1)
    task = Task("merge", MERGE, arguments)
    answers = executor.map([task], limits=limits, on_report=lambda key, fields: take(fields))
    with stopped_after(answers) as ends:
        (done,) = ends
    return done.outcome


def _unmerged(seen: str | None) -> BundleError:
    return BundleError(
        "the process that merges the parts ended",
        seen=seen or "",
        mend="the parts are whole: the same command merges them",
    )


def _check_free(out: Path) -> None:
    """Raises where a bundle couldn't be put, before anything is played.

    Raises:
        BundleError: something lies there.
    """
    try:
        names = sorted(path.name for path in out.iterdir())
        is_mount = os.path.ismount(out)  # Path's own doesn't know Windows before Python 3.12
    except FileNotFoundError:
        return
    except OSError as error:
        raise BundleError(
            "the run's folder can't be used", where=str(out), seen=error.strerror or str(error),
            mend="name another with --out",
        ) from None  # fmt: skip
    if is_mount:
        raise BundleError(
            "a whole run can't take the place of a mounted disk in one step",
            where=str(out),
            mend="name a folder on it",
        )
    if names:
        raise BundleError(
            "the folder isn't empty",
            where=str(out),
            expected="a folder that doesn't exist yet, or is empty",
            seen=", ".join(names[:5]) + (", ..." if len(names) > 5 else ""),
            mend="choose another folder, or move this one away first",
        )
