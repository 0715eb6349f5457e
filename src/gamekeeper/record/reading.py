"""Reads a bundle: a sealed one from Parquet, an open or killed one up to its last whole turn."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa

from gamekeeper.errors import BundleError
from gamekeeper.record.folder import digest_file, inside
from gamekeeper.record.manifest import MANIFEST, Seal, load_manifest, seal_of
from gamekeeper.record.schema import STREAMS, keys_of
from gamekeeper.record.segments import Cut
from gamekeeper.record.streams import StreamFiles, keep, merge, whole_of
from gamekeeper.record.table_reader import TableReader


@dataclass(frozen=True, slots=True)
class Bundle:
    """What a bundle's folder holds.

    Args:
        path: the folder.
        manifest: manifest.json.
        episodes: a row an episode, sorted.
        steps: a row an agent's decision.
        states: a row a turn, None where no states were recorded.
        timings: a row a finished turn, None where none were recorded.
        sealed: False for a run that is still recorded, or was killed.
        cuts: the files of an open bundle that end within a message, and why the rest doesn't count.
    """

    path: Path
    manifest: dict[str, Any]
    episodes: pa.Table
    steps: pa.Table
    states: pa.Table | None
    timings: pa.Table | None
    sealed: bool
    cuts: tuple[Cut, ...] = ()


def read(path: str | PathLike[str], *, check: bool = True, salvage: bool = False) -> Bundle:
    """The evidence in a folder; of a run that was never sealed, its whole turns.

    Args:
        path: the folder of the bundle.
        check: compare every file of a sealed bundle with the seal before it is decoded.
        salvage: in an open bundle, damage ends a stream as a cut does, in place of raising.
    Raises:
        BundleError: there is no bundle, it is damaged, or written in a newer format.
    """
    folder = Path(path)
    manifest = load_manifest(folder)
    try:
        return _read(folder, manifest, check=check, salvage=salvage)
    except BundleError:
        again = load_manifest(folder)
        if again == manifest:
            raise
        # The recorder sealed it in between, and what was being read has been replaced.
        return _read(folder, again, check=check, salvage=salvage)


def _read(folder: Path, manifest: dict[str, Any], *, check: bool, salvage: bool) -> Bundle:
    seal = seal_of(manifest, folder / MANIFEST)
    if seal is not None:
        tables = {name: _sealed_table(folder, name, seal, check=check) for name in STREAMS}
        return _bundle(folder, manifest, tables, is_sealed=True)
    streams = {name: StreamFiles(folder, name, salvage=salvage) for name in STREAMS}
    tables = {name: streams[name].table() for name in STREAMS}
    whole = whole_of(
        {
            name: table.to_batches() if table is not None else []
            for name, table in tables.items()
            if streams[name].exists()
        }
    )
    for name, table in tables.items():
        if table is not None and name != "episodes":
            tables[name] = table.filter(keep(whole, name, table))
    if tables["episodes"] is not None:
        tables["episodes"] = merge(tables["episodes"], whole)
    cuts = tuple(cut for stream in streams.values() for cut in stream.cuts)
    return _bundle(folder, manifest, tables, is_sealed=False, cuts=cuts)


def _sealed_table(folder: Path, stream: str, seal: Seal, *, check: bool) -> pa.Table | None:
    name = f"{stream}.parquet"
    if name not in seal.files:
        return None
    path = inside(folder, name)
    if check and digest_file(path) != seal.files[name]:
        raise BundleError(
            f"{name} was changed after it was sealed",
            where=str(path),
            expected=f"{seal.files[name][0]} bytes with digest {seal.files[name][1][:16]}...",
            mend="restore the file from a copy; `gamekeeper verify` lists all damage",
        )
    return TableReader(path, stream).read()


def _bundle(
    folder: Path,
    manifest: dict[str, Any],
    tables: dict[str, pa.Table | None],
    *,
    is_sealed: bool,
    cuts: tuple[Cut, ...] = (),
) -> Bundle:
    for name in ("episodes", "steps"):
        if tables[name] is None:
            keys = [pa.field(key, pa.int32()) for key in keys_of(name)]
            tables[name] = pa.schema(keys).empty_table()
    return Bundle(folder, manifest, **tables, sealed=is_sealed, cuts=cuts)
