"""Evidence out of a bundle."""

from __future__ import annotations

from os import PathLike

from gamekeeper.core.evidence import Evidence
from gamekeeper.core.tables import MemoryTables
from gamekeeper.record.reading import read


def load(path: str | PathLike[str]) -> Evidence:
    """The evidence in a bundle, also of one that is still recorded or was killed, up to its last whole turn.

    Raises:
        BundleError: there is no bundle, it is damaged, or of a newer format.
    """
    bundle = read(path)
    tables = {name: getattr(bundle, name) for name in ("episodes", "steps", "states", "timings")}
    kept = {name: table for name, table in tables.items() if table is not None}
    return Evidence(bundle.manifest, MemoryTables(kept), path=bundle.path)
