"""Seals a run whose recorder is gone, as far as its turns are whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa

from gamekeeper.errors import BundleError
from gamekeeper.record.files.claim import lock_folder
from gamekeeper.record.files.folder import reading, system_error
from gamekeeper.record.files.manifest import FORMAT_VERSION, load_manifest
from gamekeeper.record.files.schema import STREAMS, plain_batch, plain_schema
from gamekeeper.record.files.seal import commit
from gamekeeper.record.files.segments import Cut
from gamekeeper.record.files.streams import StreamFiles, keep, merge_whole, whole_of
from gamekeeper.record.files.table_writer import write_table
from gamekeeper.record.files.whole import Whole


def seal_recovered(
    path: str | PathLike[str], manifest: dict[str, Any], *, episodes: pa.Table | None = None
) -> tuple[Cut, ...]:
    """The whole turns of a killed run are sealed; memory stays bounded by a row group.

    What is sealed is what `read(path, salvage=True)` gives.

    Args:
        path: the folder of the bundle.
        manifest: plain JSON; its `status` is "recovered" if it names none. Where files ended early,
            `cuts` is added: file, offset, why.
        episodes: the rows of episodes to be sealed in place of those found (an end "torn" added).
    Returns:
        Where the files ended early.
    Raises:
        BundleError: it is sealed already or still being recorded, or the disk refuses.
    """
    folder = Path(path)
    with reading(folder):
        load_manifest(folder)  # says what is there, where that is no bundle
    lock = lock_folder(folder)
    try:
        with reading(folder):
            return _seal(folder, {"status": "recovered", **manifest}, episodes)
    finally:
        if lock >= 0:
            os.close(lock)


def _seal(folder: Path, manifest: dict[str, Any], episodes: pa.Table | None) -> tuple[Cut, ...]:
    if load_manifest(folder)["status"] != "open":
        raise BundleError(
            "the bundle is sealed already",
            where=str(folder),
            mend="read it as it is; `gamekeeper verify` says whether it is undamaged",
        )
    streams = {name: StreamFiles(folder, name, salvage=True) for name in STREAMS}
    # A first pass reads only keys; a stream without a file has no batches and no schema after it.
    whole = whole_of(
        {name: stream.batches() for name, stream in streams.items() if stream.exists()}
    )
    cuts = tuple(cut for stream in streams.values() for cut in stream.cuts)
    files = {}
    try:
        for name, stream in streams.items():
            if name == "episodes":
                found = stream.table()
                table = episodes if episodes is not None else _merged(found, whole)
                if table is not None:
                    files[name] = write_table(folder, name, table.schema, table.to_batches())
            elif stream.schema is not None:
                schema = plain_schema(stream.schema)
                rows = _kept(stream, schema, whole)
                files[name] = write_table(folder, name, schema, rows)
        said = {key: value for key, value in manifest.items() if key != "cuts"}
        if cuts:
            said["cuts"] = [asdict(cut) for cut in cuts]
        commit(folder, {**said, "format_version": FORMAT_VERSION}, files)
    except BaseException as error:
        for draft, _, _ in files.values():
            draft.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, BundleError):
            raise system_error("sealing", folder, error) from error
        raise
    return cuts


def _kept(stream: StreamFiles, schema: pa.Schema, whole: Whole) -> Iterator[pa.RecordBatch]:
    for batch in stream.batches():
        kept = batch.filter(keep(whole, stream.stream, batch))
        if kept.num_rows:
            yield plain_batch(kept, schema)


def _merged(found: pa.Table | None, whole: Whole) -> pa.Table | None:
    return None if found is None else merge_whole(found, whole)
