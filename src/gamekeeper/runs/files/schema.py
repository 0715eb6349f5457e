"""Columns that a run's streams may hold; two schemas of one stream become one."""

from typing import Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.evidence import NO_STEPS
from gamekeeper.errors import RunError
from gamekeeper.runs.untrusted.limits import row_bytes

STREAMS: Final = ("episodes", "agent_steps", "states", "timings")
LATER: Final = ("opening",)
"""Columns that runs written before they were introduced don't have."""
KNOWN: Final = {
    "episodes": pa.schema([field for field in EPISODES if field.name not in LATER]),
    "agent_steps": NO_STEPS,
    "timings": pa.schema([("wall_ns", pa.int64())]),
}
"""Columns that a stream of a run always has; others depend on its spaces and contract."""
ABSENT: Final = {
    "episodes": frozenset(EPISODES.names) - {"episode", "turns", "end"},
    "agent_steps": frozenset(("action_mask", "cumulative_reward", "info")),
}
"""Columns that the Parquet files of level `actions` leave out without a value in them."""
Keys = npt.NDArray[np.int64]
DEPTH: Final = 32  # nested types
LIST_BYTES: Final = 1 << 24  # a row of a fixed-size list; what is longer stands as bytes
COLUMNS: Final = 1 << 16
EXTENSION: Final = (
    b"ARROW:extension:"  # in a schema's bytes: a type that some package may have registered
)


def keys_of(stream: str) -> tuple[str, ...]:
    """The int32 columns that come first in a stream; the rows of an evaluation have none."""
    if stream == "evaluations":
        return ()
    return ("episode",) if stream == "episodes" else ("episode", "turn")


def check_schema(schema: pa.Schema, stream: str, *, where: str) -> None:
    """Checks that any reader understands the schema, and that reading it runs no foreign code.

    Raises:
        RunError: the key columns aren't first, a name stands twice, or a type isn't plain.
    """
    keys = keys_of(stream)
    if tuple(schema.names[: len(keys)]) != keys or any(
        not pa.types.is_int32(schema.field(i).type) for i in range(len(keys))
    ):
        raise _refused(
            where, f"the first columns: {', '.join(keys)} (int32)", str(schema.names[:3])
        )
    if len(set(schema.names)) != len(schema.names):
        raise _refused(where, "every column's name once", "a name that stands twice")
    if len(schema.names) > COLUMNS:
        raise _refused(where, f"at most {COLUMNS} columns", str(len(schema.names)))
    for field in schema:
        if not _is_plain(field, DEPTH):
            raise _refused(
                where, "numbers, text, bytes, lists and structs", f"{field.name}: {field.type}"
            )


def check_columns(schema: pa.Schema, stream: str, *, where: str) -> None:
    """Checks the columns that every reader of a run relies on, and their types.

    A run that was killed before its first turn has the key columns alone.

    Raises:
        RunError: one is missing, or has another type.
    """
    if tuple(schema.names) == keys_of(stream):
        return
    for field in KNOWN.get(stream, ()):
        place = schema.get_field_index(field.name)
        seen = "none of this name" if place < 0 else str(_plain_type(schema.field(place).type))
        if seen not in (str(field.type), "null"):
            raise _refused(where, f"a column {field.name} ({field.type})", seen)


def plain_schema(schema: pa.Schema) -> pa.Schema:
    """The schema with dictionaries as their values, every column nullable, no further metadata."""
    fields = [field.with_type(_plain_type(field.type)).with_nullable(True) for field in schema]
    return pa.schema(fields)


def with_absent(schema: pa.Schema, stream: str) -> pa.Schema:
    """The schema with the columns that a file of level `actions` left out, each in its place."""
    if (schema.metadata or {}).get(b"level") != b"actions":
        return schema
    names, fields, behind = set(schema.names), list(schema), len(schema)
    for field in reversed(EPISODES if stream == "episodes" else NO_STEPS):
        if field.name in names:
            behind = schema.get_field_index(field.name)
        elif field.name in ABSENT.get(stream, ()):  # a forged file may say so of any stream
            fields.insert(behind, field)
    return pa.schema(fields)


def plain_batch(batch: pa.RecordBatch, schema: pa.Schema) -> pa.RecordBatch:
    """The batch in a schema that holds its columns, what it lacks being null."""
    if batch.schema.equals(schema, check_metadata=True):
        return batch
    have = set(batch.schema.names)
    columns = [
        batch.column(field.name).cast(field.type)
        if field.name in have
        else pa.nulls(batch.num_rows, field.type)
        for field in schema
    ]
    return pa.record_batch(columns, schema=schema)


def unify(first: pa.Schema, second: pa.Schema, *, where: str) -> pa.Schema:
    """The schema that holds both: columns are added, none changes its type (nothing is coerced).

    Raises:
        RunError: a column has two types.
    """
    try:
        return pa.unify_schemas([first, second])
    except pa.ArrowException as error:
        raise RunError(
            "a column changes its type within one stream",
            where=where,
            actual=str(error).splitlines()[0],
            fix="give values of another type a column of another name",
        ) from error


def key_arrays(batch: pa.RecordBatch | pa.Table, stream: str, *, where: str) -> tuple[Keys, Keys]:
    """[rows] episode and [rows] turn of a batch (turn: zeros for episodes), checked for sense.

    Raises:
        RunError: a key is null or negative.
    """
    keys = [batch.column(i) for i in range(len(keys_of(stream)))]
    if any(key.null_count for key in keys):
        raise _refused(where, "no null in a key column", "a null")
    arrays = [np.asarray(key).astype(np.int64) for key in keys]
    if batch.num_rows and min(int(array.min()) for array in arrays) < 0:
        raise _refused(where, "keys of 0 and more", "a negative key")
    return arrays[0], arrays[1] if len(arrays) > 1 else np.zeros_like(arrays[0])


def _plain_type(kind: pa.DataType) -> pa.DataType:
    return kind.value_type if pa.types.is_dictionary(kind) else kind


def _is_plain(field: pa.Field, depth: int) -> bool:
    kind, t = field.type, pa.types
    if field.metadata and any(key.startswith(EXTENSION) for key in field.metadata):
        return False
    if depth == 0 or isinstance(kind, pa.BaseExtensionType):
        return False
    if t.is_struct(kind):
        return all(_is_plain(kind.field(i), depth - 1) for i in range(kind.num_fields))
    if t.is_fixed_size_list(kind) and row_bytes(kind) > LIST_BYTES:
        return False
    if t.is_list(kind) or t.is_large_list(kind) or t.is_fixed_size_list(kind):
        return _is_plain(kind.value_field, depth - 1)
    return bool(
        t.is_null(kind)
        or t.is_boolean(kind)
        or t.is_integer(kind)
        or t.is_floating(kind)
        or t.is_string(kind)
        or t.is_large_string(kind)
        or t.is_binary(kind)
        or t.is_large_binary(kind)
        or t.is_fixed_size_binary(kind)
        or t.is_timestamp(kind)
        or t.is_duration(kind)
    )


def _refused(where: str, expected: str, seen: str) -> RunError:
    return RunError(
        "columns that a run doesn't hold",
        where=where,
        expected=expected,
        actual=seen,
        fix="restore the run from a copy, or record it again",
    )
