"""Columns of parts put together: what one of them names otherwise, or lacks, finds its place.

A column's name tells apart who else is in a run, so a late joiner's may be called otherwise in
another part. What it holds is its leaf (tag, dtype, shape): digests and readers go by that.
"""

from __future__ import annotations

from collections.abc import Mapping

import pyarrow as pa

from gamekeeper.errors import BundleError
from gamekeeper.record.files.schema import plain_schema


class Columns:
    """The columns of one stream over all parts; they grow, and none changes its type."""

    __slots__ = ("_fields", "_stream")

    def __init__(self, stream: str) -> None:
        self._stream = stream
        self._fields: dict[str, pa.Field] = {}

    @property
    def schema(self) -> pa.Schema:
        """All columns there are so far: what parts share first, in their order."""
        return pa.schema(list(self._fields.values()))

    def widen(self, schema: pa.Schema) -> None:
        """The columns of one more part have their places.

        Raises:
            BundleError: a column without a leaf changes its type.
        """
        plain = plain_schema(schema)
        names = self.names(plain)
        for field in plain:
            name = names[field.name]
            known = self._fields.get(name)
            if known is None:
                self._fields[name] = field.with_name(name)
            elif known.type != field.type:
                raise BundleError(
                    "a column has another type in another part",
                    where=f"{self._stream}, {field.name}",
                    expected=str(known.type),
                    seen=str(field.type),
                    mend="record in one process, without --workers",
                )

    def fit(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """A part's batch with its columns named as they are in the whole."""
        names = self.names(batch.schema)
        if all(name == place for name, place in names.items()):
            return batch
        return batch.rename_columns([names[name] for name in batch.schema.names])

    def names(self, schema: pa.Schema) -> Mapping[str, str]:
        """By a part's name of each of its columns the name in the whole."""
        found: dict[str, str] = {}
        strange: list[pa.Field] = []
        for field in schema:
            known = self._fields.get(field.name)
            if known is not None and _leaf(known) == _leaf(field):
                found[field.name] = field.name
            else:
                strange.append(field)
        for field in strange:
            found[field.name] = self._place(field, taken=set(found.values()))
        return found

    def _place(self, field: pa.Field, *, taken: set[str]) -> str:
        """Where a column goes that isn't known by its name: to its equal, else to a new name."""
        leaf = _leaf(field)
        if leaf is not None:
            for name, known in self._fields.items():
                if name not in taken and _leaf(known) == leaf and known.type == field.type:
                    return name
        name = str(field.name)
        while name in taken or (name in self._fields and leaf is not None):
            name += "'"
        return name


def _leaf(field: pa.Field) -> tuple[bytes, bytes] | None:
    """What a value column holds, whatever its name; None for a column that every run has."""
    metadata = field.metadata or {}
    return (metadata[b"tag"], metadata[b"leaf"]) if b"leaf" in metadata else None
