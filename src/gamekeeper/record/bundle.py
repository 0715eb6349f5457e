"""Evidence out of a bundle."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from gamekeeper.core.evidence import Evidence
from gamekeeper.core.tables import MemoryTables, Tables
from gamekeeper.record.files.fields import check_fields
from gamekeeper.record.files.folder import reading
from gamekeeper.record.files.manifest import MANIFEST, load_manifest, seal_of
from gamekeeper.record.files.reading import check_sealed, read
from gamekeeper.record.files.schema import STREAMS, check_columns
from gamekeeper.record.files.sealed import SealedTables


def load(path: str | PathLike[str], *, check: bool = True, salvage: bool = False) -> Evidence:
    """The evidence in a bundle; of one still recorded or killed, up to its last whole turn.

    Rows of a sealed bundle are read when they are looked at, an episode at a time.

    Args:
        check: compare every file of a sealed bundle with its seal first.
        salvage: in an open bundle, damage ends a stream as a cut does, in place of raising.
    Raises:
        BundleError: there is no bundle, it is damaged, or of a newer format.
    """
    folder = Path(path)
    with reading(folder):
        manifest = load_manifest(folder)
        seal = seal_of(manifest, folder / MANIFEST)
    if seal is None:
        bundle = read(folder, salvage=salvage)
        manifest = bundle.manifest
        read_now = {name: getattr(bundle, name) for name in STREAMS}
        found = {name: table for name, table in read_now.items() if table is not None}
        tables: Tables = MemoryTables(found)
        schemas = {name: table.schema for name, table in found.items()}
    else:
        if check:
            check_sealed(folder, manifest, seal)
        sealed = SealedTables(folder, [name for name in STREAMS if f"{name}.parquet" in seal.files])
        tables, schemas = sealed, sealed.schemas
    check_fields(manifest, folder / MANIFEST)
    for stream, schema in schemas.items():
        check_columns(schema, stream, where=f"{folder}, {stream}")
    return Evidence(manifest, tables, path=folder)
