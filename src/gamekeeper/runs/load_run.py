"""Loads evidence out of a run."""

from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.tables import MemoryTables, Tables
from gamekeeper.errors import RunError
from gamekeeper.runs.files.checksums import root_digest
from gamekeeper.runs.files.folder import MANIFEST, reading
from gamekeeper.runs.files.manifest import checksums_of, load_manifest
from gamekeeper.runs.files.open_streams import open_tables
from gamekeeper.runs.files.run_files import ParquetTables, check_finalized
from gamekeeper.runs.files.schema import STREAMS, check_columns
from gamekeeper.runs.untrusted.limits import check_fields


def load(path: str | PathLike[str], *, check: bool = True, salvage: bool = False) -> Evidence:
    """The evidence in a run; of one still recorded or killed, up to its last whole turn.

    Rows of a finalized run are read when they are looked at, an episode at a time.

    Args:
        check: compare every file of a finalized run with its checksums first.
        salvage: in an open run, damage ends a stream as a cut does, in place of raising.
    Raises:
        RunError: there is no run, it is damaged, or of a newer format.
    """
    folder = Path(path)
    tables: Tables | None = None
    while tables is None:
        with reading(folder):
            manifest = load_manifest(folder)
            checksums = checksums_of(manifest, folder / MANIFEST)
        if checksums is None:
            found = _whole_turns(folder, manifest, salvage=salvage)
            tables = None if found is None else MemoryTables(found)
            schemas = {name: table.schema for name, table in (found or {}).items()}
        else:
            if check:
                check_finalized(folder, manifest, checksums)
            names = [name for name in STREAMS if f"{name}.parquet" in checksums.files]
            finalized = ParquetTables(folder, names)
            tables, schemas = finalized, finalized.schemas
    check_fields(manifest, folder / MANIFEST)
    for stream, schema in schemas.items():
        check_columns(schema, stream, where=f"{folder}, {stream}")
    root = None if checksums is None else root_digest(folder, check=False)
    return Evidence(manifest, tables, path=folder, root=root)


def _whole_turns(
    folder: Path, manifest: dict[str, Any], *, salvage: bool
) -> dict[str, pa.Table] | None:
    """The whole turns of an open run by stream; None where it was finalized meanwhile.

    The segments that are being read may be gone then, so that the run looks empty or damaged.
    """
    try:
        found, _ = open_tables(folder, manifest, salvage=salvage)
    except RunError:
        if load_manifest(folder) == manifest:
            raise
        return None
    return found if load_manifest(folder) == manifest else None
