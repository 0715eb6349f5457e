"""What a column says of itself is believed only where it can be so."""

import json

import pyarrow as pa
import pytest

from gamekeeper.episodes.layout import value_columns
from gamekeeper.errors import EvidenceError

LEAF = {"path": "", "kind": "list", "dtype": "<f4", "shape": [2]}


def schema_of(leaf: bytes, kind: pa.DataType | None = None) -> pa.Schema:
    """One column that says `leaf` of itself."""
    kind = kind or pa.list_(pa.float32(), 2)
    return pa.schema([pa.field("obs", kind, metadata={"leaf": leaf, "tag": "obs"})])


def test_column_that_fits_is_found() -> None:
    """A leaf whose kind, dtype and shape are those of the type is taken."""
    assert [each.name for each in value_columns(schema_of(json.dumps(LEAF).encode()), "obs")] == [
        "obs"
    ]


@pytest.mark.parametrize(
    "leaf",
    [
        b"",
        b'{"path": "", "kind',
        b"[]",
        b"{}",
        json.dumps({**LEAF, "kind": "pickle"}).encode(),
        json.dumps({**LEAF, "dtype": "|O"}).encode(),
        json.dumps({**LEAF, "dtype": "nothing"}).encode(),
        json.dumps({**LEAF, "dtype": "<f8"}).encode(),
        json.dumps({**LEAF, "shape": [3]}).encode(),
        json.dumps({**LEAF, "shape": [-2]}).encode(),
        json.dumps({**LEAF, "shape": ["2"]}).encode(),
        json.dumps({**LEAF, "kind": "int"}).encode(),
    ],
)
def test_column_that_lies_is_refused(leaf: bytes) -> None:
    """Broken JSON, missing parts, another type or length: an EvidenceError that names it."""
    with pytest.raises(EvidenceError, match="obs"):
        value_columns(schema_of(leaf), "obs")
