"""Reads a bundle: a sealed one from Parquet, an open or killed one up to its last whole turn."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa

from gamekeeper.core.evidence import NO_STEPS
from gamekeeper.core.press import EPISODES
from gamekeeper.errors import BundleError
from gamekeeper.record.files.folder import digest_file, inside, reading
from gamekeeper.record.files.manifest import MANIFEST, Seal, load_manifest, manifest_digest, seal_of
from gamekeeper.record.files.schema import STREAMS
from gamekeeper.record.files.segments import Cut
from gamekeeper.record.files.streams import StreamFiles, keep, merge_whole, whole_of
from gamekeeper.record.files.table_reader import TableReader


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
    with reading(folder):
        manifest = load_manifest(folder)
        while True:
            seal = seal_of(manifest, folder / MANIFEST)
            try:
                if seal is not None:
                    return _read_sealed(folder, manifest, seal, check=check)
                bundle = _read_open(folder, manifest, salvage=salvage)
            except BundleError:
                again = load_manifest(folder)
                if again == manifest:
                    raise
            else:
                again = load_manifest(folder)
                if again == manifest:
                    return bundle
            # The recorder sealed it meanwhile: the segments that were being read may be gone.
            manifest = again


def check_sealed(folder: Path, manifest: dict[str, Any], seal: Seal) -> None:
    """Compares the manifest and every table of a sealed bundle with its seal.

    Raises:
        BundleError: one of them isn't as it was sealed.
    """
    if manifest_digest(manifest) != seal.manifest:
        raise _changed(folder / MANIFEST, "the manifest that was sealed", "another")
    for stream in STREAMS:
        _check_table(folder, f"{stream}.parquet", seal)


def _check_table(folder: Path, name: str, seal: Seal) -> None:
    path = inside(folder, name)
    if name not in seal.files:
        if path.exists():
            raise _changed(path, "sealed files alone", "a file that the seal doesn't name")
        return
    size, digest = digest_file(path)
    if (size, digest) != seal.files[name]:
        expected = f"{seal.files[name][0]} bytes, digest {seal.files[name][1][:16]}..."
        raise _changed(path, expected, f"{size} bytes, digest {digest[:16]}...")


def _read_sealed(folder: Path, manifest: dict[str, Any], seal: Seal, *, check: bool) -> Bundle:
    if check:
        check_sealed(folder, manifest, seal)
    tables = {
        name: TableReader(inside(folder, f"{name}.parquet"), name).read()
        if f"{name}.parquet" in seal.files
        else None
        for name in STREAMS
    }
    return _bundle(folder, manifest, tables, is_sealed=True)


def _read_open(folder: Path, manifest: dict[str, Any], *, salvage: bool) -> Bundle:
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
        tables["episodes"] = merge_whole(tables["episodes"], whole)
    cuts = tuple(cut for stream in streams.values() for cut in stream.cuts)
    return _bundle(folder, manifest, tables, is_sealed=False, cuts=cuts)


def _changed(path: Path, expected: str, seen: str) -> BundleError:
    return BundleError(
        f"{path.name} was changed after it was sealed",
        where=str(path),
        expected=expected,
        seen=seen,
        mend="restore it from a copy; `gamekeeper verify` lists all damage",
    )


def _bundle(
    folder: Path,
    manifest: dict[str, Any],
    tables: dict[str, pa.Table | None],
    *,
    is_sealed: bool,
    cuts: tuple[Cut, ...] = (),
) -> Bundle:
    for name, schema in (("episodes", EPISODES), ("steps", NO_STEPS)):
        if tables[name] is None:  # it ended before its first row; who reads it finds the columns
            tables[name] = schema.empty_table()
    return Bundle(folder, manifest, **tables, sealed=is_sealed, cuts=cuts)
