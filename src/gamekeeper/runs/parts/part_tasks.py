"""Tasks of workers: play a part of a recording, merge the parts into one run."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EnvError, GamekeeperError, RunError
from gamekeeper.interface.construction import foreign_traceback
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.runs.files.folder import MANIFEST, lock_folder, sync_folder, system_error
from gamekeeper.runs.load_run import load
from gamekeeper.runs.parts.fan_out import lost
from gamekeeper.runs.parts.merged_run import MergedRun
from gamekeeper.runs.parts.part_plan import FOLDER, key_of, note_merged
from gamekeeper.runs.parts.receipts import (
    Receipt,
    attempt_folder,
    is_torn,
    receipt_of,
    receipts_of,
    schemas_of,
)
from gamekeeper.runs.recording import record_rollout
from gamekeeper.runs.run_check import recover
from gamekeeper.runs.worker_tasks import reported, signs_of_life
from gamekeeper.terminal import say

# -- Parts as workers play them: each in a fresh environment, into a run of its own
#
# The answer of a task is small; the evidence goes from the worker to storage.


def part_task(
    report: Callable[..., None], *, storage: str, plan: Mapping[str, Any], first: int, stop: int
) -> dict[str, Any]:
    """Plays the episodes from `first` to before `stop`, unless their receipt is there already.

    Returns:
        `error` (its fields, where there is no part that counts), else `episodes`, `turns` and
        `failed`: true if the last one did.
    """
    place, key = Storage.at(storage), key_of(range(first, stop))
    found = receipt_of(place, key)
    if found is not None:  # an attempt that was thought dead, or whose answer got lost
        return {"error": None, **found.summary()}
    try:
        receipt = _played(report, place, RolloutPlan.from_json(plan), range(first, stop))
        with signs_of_life(report):
            receipt.put(place)
    except GamekeeperError as error:
        return {"error": error.to_json()}
    return {"error": None, **receipt.summary()}


def again_task(
    report: Callable[..., None], *, plan: Mapping[str, Any], first: int, stop: int
) -> str:
    """Plays episodes again, with an environment and policies that are new; the last's digest."""
    some = RolloutPlan.from_json(plan).part(range(first, stop))
    evidence = record_rollout(some, progress=reported(report, stop - first))
    return str(evidence.header(stop - 1)["fingerprint"])


def remains_task(
    report: Callable[..., None],
    *,
    storage: str,
    first: int,
    stop: int,
    error: Mapping[str, str],
    stack: str | None,
) -> dict[str, Any]:
    """Finalizes the whole turns of a part whose attempts all died.

    The last attempt with an episode counts. Attempts that wrote to a disk of their worker's own
    have left nothing.
    """
    place, key = Storage.at(storage), key_of(range(first, stop))
    found = receipt_of(place, key)
    if found is not None:
        return {"error": None, **found.summary()}
    parent = place.path_of(FOLDER)
    tries = sorted(parent.glob(f"{key}.*/"), key=_changed_s) if parent is not None else []
    # the last line names the error, as in a traceback of Python
    line = f"{error['what']}: {error['actual']}".removesuffix(": ")
    text = line if not stack else f"{stack}\n{line}"
    with signs_of_life(report):
        for run_files in reversed(tries):
            try:
                evidence = recover(run_files, status="failed", error=text)
            except RunError:  # it died before there was a manifest
                continue
            if evidence.episode_table.num_rows:
                receipt = _receipt(
                    key, f"{FOLDER}/{run_files.name}", run_files, evidence, first, error
                )
                receipt.put(place)
                return {"error": None, **receipt.summary()}
    return {"error": None, "episodes": 0, "turns": 0, "failed": True}


def _played(
    report: Callable[..., None], storage: Storage, plan: RolloutPlan, episodes: range
) -> Receipt:
    key = key_of(episodes)
    name = attempt_folder(key)
    failed: Mapping[str, str] | None = None
    with _on_this_machine(storage, name) as run_files:
        try:
            evidence = record_rollout(
                plan.part(episodes),
                run_files,
                progress=reported(report, len(episodes)),
                durable=False,
            )
        except EnvError as error:
            if error.__cause__ is not None:
                say(foreign_traceback(error.__cause__))
            failed = error.to_json()
            if not (run_files / MANIFEST).exists():  # it failed before there was a run
                raise
            evidence = load(run_files, check=False)
        with signs_of_life(report):
            receipt = _receipt(key, name, run_files, evidence, episodes.start, failed)
            if storage.folder is None:
                storage.put_folder(name, run_files)
            return receipt


def _receipt(
    key: str,
    name: str,
    run_files: Path,
    evidence: Evidence,
    first: int,
    error: Mapping[str, str] | None,
) -> Receipt:
    table = evidence.episode_table
    turns = pc.sum(table["turns"]).as_py() or 0
    return Receipt(key, name, first, table.num_rows, turns, error, schemas_of(run_files))


@contextmanager
def _on_this_machine(storage: Storage, name: str, *, is_fetched: bool = False) -> Iterator[Path]:
    """A folder of storage as one of this machine, meanwhile: itself where that is a folder.

    Else a scratch folder, into which it is fetched first if `is_fetched`.
    """
    place = storage.path_of(name)
    if place is not None:
        yield place
        return
    scratch = tempfile.mkdtemp(prefix="gamekeeper-part-")
    try:
        folder = Path(scratch) / "run_files"
        if is_fetched:
            storage.fetch_folder(name, folder)
        yield folder
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _changed_s(folder: Path) -> float:
    """Time at which a file of a folder was last changed."""
    return max((path.stat().st_mtime for path in folder.rglob("*")), default=0.0)


# -- Parts into one run: the one that a single process would have recorded
#
# Streamed, batch by batch, a part at a time: memory holds a row group and a row for each episode.
# The run is put together beside its place and moved there when it is finalized, so that its place
# holds either nothing or all of it.


def merge_task(
    report: Callable[..., None],
    *,
    storage: str,
    plan: Mapping[str, Any],
    out: str,
    parts: int,
    error: str | None,
    ended: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Merges the first parts of a plan into the folder `out`.

    Args:
        parts: number of the plan's parts that one process would have recorded.
        error: the error that ended the run, if no part has it; the run counts as failed then.
        ended: fields of the error of the first episode that failed, to be noted.
    Returns:
        `error`: None, or its fields; `torn`: keys of the parts that are damaged, if that is it.
    """
    found: list[Receipt] = []
    place = Storage.at(storage)
    try:
        with signs_of_life(report):
            wanted = RolloutPlan.from_json(plan)
            found = _found(place, [key_of(each) for each in islice(wanted.ranges(), parts)])
            merge(
                place,
                found,
                Path(out),
                error=error,
                after_part=lambda done: report(merged=done),
                when_finalized=partial(note_merged, place, wanted, parts=parts, ended=ended),
            )
    except GamekeeperError as raised:
        with signs_of_life(report):
            return {"error": raised.to_json(), "torn": _torn(place, found)}
    return {"error": None, "torn": []}


def _found(storage: Storage, keys: list[str]) -> list[Receipt]:
    """The receipts of all these parts.

    Raises:
        RunError: one isn't there.
    """
    found = []
    for key, receipt in zip(keys, receipts_of(storage, keys), strict=True):
        if receipt is None:
            raise lost(storage, key)
        found.append(receipt)
    return found


def _torn(storage: Storage, parts: list[Receipt]) -> list[str]:
    """The keys of the parts that aren't as they were finalized: parts aren't synced."""
    keys = []
    for receipt in parts:
        with _on_this_machine(storage, receipt.folder, is_fetched=True) as part:
            if is_torn(part):
                keys.append(receipt.key)
    return keys


def merge(
    storage: Storage,
    parts: list[Receipt],
    out: Path,
    *,
    error: str | None = None,
    after_part: Callable[[int], None] = lambda done: None,
    when_finalized: Callable[[Path], None] = lambda draft: None,
) -> None:
    """Merges parts into the run `out`, in the order of their episodes, with one list of checksums.

    Args:
        parts: sorted by episodes, without a gap.
        out: a folder that doesn't exist yet, or is empty.
        error: the error that ended the run, if no part has it.
        after_part: called with the number of parts that are in.
        when_finalized: called with the folder of the whole run, before it is at its place.
    Raises:
        RunError: there is no part, one is damaged or of another environment, something lies in
            `out`, or the disk refuses.
    """
    if not parts:
        raise RunError(
            "there is no part to merge",
            where=str(storage),
            fix="repeat the command: its parts are played again",
        )
    place = out.resolve()  # a link to an empty folder is no folder that one can take the place of
    draft = place.with_name(f".{place.name}.merging")
    _clear(draft)
    whole = MergedRun(draft, parts)
    try:
        for done, receipt in enumerate(parts, start=1):
            with _on_this_machine(storage, receipt.folder, is_fetched=True) as part:
                whole.add(receipt, part)
            after_part(done)
        whole.finalize(error)
    except BaseException:
        whole.discard()
        raise
    when_finalized(draft)
    _publish(draft, place)


def _clear(draft: Path) -> None:
    """Removes the draft that a killed merge left.

    Raises:
        RunError: another merge is at work there.
    """
    if draft.is_dir() and not draft.is_symlink():
        lock = lock_folder(draft)
        if lock >= 0:
            os.close(lock)
        shutil.rmtree(draft)


def _publish(draft: Path, out: Path) -> None:
    """Moves the finalized run to its place, in one step.

    Raises:
        RunError: something lies there, or the disk refuses.
    """
    try:
        draft.replace(out)  # over an empty folder, never over one that holds something
        sync_folder(out.parent)
    except OSError as error:
        raise system_error(f"moving {draft.name} to its place", out, error) from error
