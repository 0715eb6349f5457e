"""Parts into one bundle: the one that a single process would have recorded.

Streamed, batch by batch, a part at a time: memory holds a row group and a row for each episode. The
bundle is put together beside its place and moved there when it is sealed, so that its place holds
either nothing or all of it.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from gamekeeper.errors import BundleError, GamekeeperError
from gamekeeper.record.files.claim import lock_folder
from gamekeeper.record.files.folder import sync_folder, system_error
from gamekeeper.record.parts.joined import Joined
from gamekeeper.record.parts.merged import note_merged
from gamekeeper.record.parts.plan import Plan, key_of
from gamekeeper.record.parts.playing import lost
from gamekeeper.record.parts.receipt import Receipt, is_torn, receipts_of
from gamekeeper.record.tasks import error_fields, signs_of_life
from gamekeeper.run.executors.storage import Storage


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
        parts: how many of the plan's parts one process would have recorded.
        error: why the run ended where no part says so; the bundle counts as failed then.
        ended: fields of the error of the first episode that failed, to be noted.

    Returns:
        `error`: None, or its fields; `torn`: keys of the parts that are damaged, if that was it.
    """
    found: list[Receipt] = []
    place = Storage.at(storage)
    try:
        with signs_of_life(report):
            wanted = Plan.from_json(plan)
            keys = [key_of(each) for each in islice(wanted.ranges(), parts)]
            found = _found(place, keys)
            merge(
                place, found, Path(out), error=error, after_part=partial(_merged, report),
                when_sealed=partial(note_merged, place, wanted, parts=parts, ended=ended),
            )  # fmt: skip
    except GamekeeperError as raised:
        with signs_of_life(report):
            return {"error": error_fields(raised), "torn": _torn(place, found)}
    return {"error": None, "torn": []}


def _found(storage: Storage, keys: list[str]) -> list[Receipt]:
    """The receipts of all these parts.

    Raises:
        BundleError: one isn't there.
    """
    found = []
    for key, receipt in zip(keys, receipts_of(storage, keys), strict=True):
        if receipt is None:
            raise lost(storage, key)
        found.append(receipt)
    return found


def _torn(storage: Storage, parts: list[Receipt]) -> list[str]:
    """The keys of the parts that aren't as they were sealed: nobody syncs parts."""
    keys = []
    for receipt in parts:
        with _fetched(storage, receipt) as part:
            if is_torn(part):
                keys.append(receipt.key)
    return keys


def _merged(report: Callable[..., None], done: int) -> None:
    report(merged=done)


def merge(
    storage: Storage,
    parts: list[Receipt],
    out: Path,
    *,
    error: str | None = None,
    after_part: Callable[[int], None] = lambda done: None,
    when_sealed: Callable[[Path], None] = lambda draft: None,
) -> None:
    """The bundle `out` holds the parts, in the order of their episodes, under one seal.

    Args:
        parts: sorted by episodes, without a gap.
        out: a folder that doesn't exist yet, or is empty.
        error: why the run ended where no part says so.
        after_part: called with how many parts are in.
        when_sealed: called with where the whole bundle lies, before it is at its place.
    Raises:
        BundleError: there is no part, one is damaged or of another environment, something lies in
            `out`, or the disk refuses.
    """
    if not parts:
        raise BundleError("there is no part to merge", where=str(storage))
    place = out.resolve()  # a link to an empty folder is no folder that one can take the place of
    draft = place.with_name(f".{place.name}.merging")
    _clear(draft)
    whole = Joined(draft, parts)
    try:
        for done, receipt in enumerate(parts, start=1):
            with _fetched(storage, receipt) as part:
                whole.add(receipt, part)
            after_part(done)
        whole.seal(error)
    except BaseException:
        whole.discard()
        raise
    when_sealed(draft)
    _publish(draft, place)


@contextmanager
def _fetched(storage: Storage, receipt: Receipt) -> Iterator[Path]:
    """A part on this machine, for as long as it is read."""
    place = storage.path_of(receipt.folder)
    if place is not None:
        yield place
        return
    with tempfile.TemporaryDirectory(prefix="gamekeeper-part-") as scratch:
        folder = Path(scratch) / "bundle"
        storage.fetch_folder(receipt.folder, folder)
        yield folder


def _clear(draft: Path) -> None:
    """What a merge left that was killed is gone.

    Raises:
        BundleError: one is at work there.
    """
    if draft.is_dir() and not draft.is_symlink():
        lock = lock_folder(draft)
        if lock >= 0:
            os.close(lock)
        shutil.rmtree(draft)


def _publish(draft: Path, out: Path) -> None:
    """The sealed bundle is at its place, in one step.

    Raises:
        BundleError: something lies there, or the disk refuses.
    """
    try:
        draft.replace(out)  # over an empty folder, never over one that holds something
        sync_folder(out.parent)
    except OSError as error:
        raise system_error(f"moving {draft.name} to its place", out, error) from error
