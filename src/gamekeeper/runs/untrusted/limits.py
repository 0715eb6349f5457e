"""Limits on files that anybody may have written: memory they ask for, fields of a manifest."""

import os
from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from gamekeeper.errors import RunError

# -- Memory that files of a given size may ask for before they are taken for a trap
#
# A few hundred bytes of zstd or of a Parquet dictionary can stand for terabytes. They are refused
# before memory is taken for them: a batch or a row group by its growth, a whole table by the
# memory that there is.

GROWTH: Final = 1000
# Any batch may ask for this much: frames of a still picture shrink 2,000-fold.
BATCH_BYTES: Final = 4 << 30
MEMORY_BYTES: Final = 64 << 30  # where the system doesn't tell how much there is
OFFSET_BYTES: Final = 8  # of an element of a list or a text, at most


def check_growth(grown_bytes: int, file_bytes: int) -> None:
    """Refuses a batch that grows more than any honest one of so many bytes.

    Raises:
        ValueError: it does.
    """
    limit = max(BATCH_BYTES, GROWTH * file_bytes)
    if grown_bytes > limit:
        raise ValueError(f"{file_bytes} bytes that unpack to more than {limit}")


def check_memory(table_bytes: int) -> None:
    """Refuses a table of more bytes than this machine has memory.

    Raises:
        ValueError: it has more.
    """
    limit = memory_bytes()
    if table_bytes > limit:
        raise ValueError(f"a table of {table_bytes} bytes, and a machine with {limit}")


def memory_bytes() -> int:
    """The machine's memory."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # no such call on Windows
        return MEMORY_BYTES


def row_bytes(kind: pa.DataType) -> int:
    """Bytes that a row of this type takes even where it is null."""
    t = pa.types
    if t.is_fixed_size_list(kind):
        return int(kind.list_size) * row_bytes(kind.value_type) + 1
    if t.is_struct(kind):
        return 1 + sum(row_bytes(kind.field(i).type) for i in range(kind.num_fields))
    try:
        return max(1, int(kind.bit_width) // 8) + 1
    except ValueError:  # a list, text or bytes, or null
        return OFFSET_BYTES + 1


# -- Shapes of the fields of a run's manifest, so that no reader meets another one further on

SHOWN: Final = 80


def check_fields(manifest: Mapping[str, Any], path: Path) -> None:
    """Refuses a field of another shape than readers expect.

    A field may be missing: a run may be killed before it is known. An unknown one is passed over:
    a newer writer may add it.
    Raises:
        RunError: a field is of another shape.
    """
    for name, expected, value in chain(_outer(manifest), _inner(manifest)):
        raise RunError(
            f"{path.name} is damaged: {name} can't be that",
            where=f"{path}, {name}"[:300],
            expected=expected,
            actual=repr(value)[:SHOWN],
            fix="restore the file from a copy, or record the run again",
        )


def _outer(manifest: Mapping[str, Any]) -> list[tuple[str, str, Any]]:
    """The fields of another shape: name, expected shape, value."""
    return [
        (name, expected, manifest[name])
        for name, (is_right, expected) in _FIELDS.items()
        if manifest.get(name) is not None and not is_right(manifest[name])
    ]


def _inner(manifest: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Yields the parts of another shape within the environment and the spaces."""
    environment = manifest.get("environment") or {}
    for kind, expected, names in ((dict, "an object", _OBJECTS), (str, "a text", _TEXTS)):
        for name in names:
            value = environment.get(name)
            if value is not None and not isinstance(value, kind):
                yield f"environment.{name}", expected, value
    for agent, pair in (manifest.get("spaces") or {}).items():
        if not isinstance(pair, dict):
            yield f"spaces.{agent}", "an object", pair
            continue
        for name in ("observation", "action"):
            if not isinstance(pair.get(name), dict | None):
                yield f"spaces.{agent}.{name}", "a space", pair[name]


def _is_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)


def _is_object(value: object) -> bool:
    return isinstance(value, dict)


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_whole(value: object) -> bool:
    return type(value) is int and abs(value) < 1 << 127


_OBJECTS: Final = ("imported", "kwargs", "versions")
_TEXTS: Final = ("api", "entry_point", "kind", "name", "path", "source_digest")
_FIELDS: Final[Mapping[str, tuple[Callable[[object], bool], str]]] = {
    "agents": (_is_texts, "a list of names"),
    "contract": (_is_object, "an object"),
    "environment": (_is_object, "an object"),
    "fingerprint": (_is_text, "a text"),
    "info_fingerprint": (_is_text, "a text"),
    "level": (_is_text, "a text"),
    "most_turns": (_is_whole, "a whole number"),
    "seed": (_is_whole, "a whole number"),
    "spaces": (_is_object, "an object"),
    "state_space": (_is_object, "a space"),
    "stopped": (_is_text, "a text"),
    "terms": (_is_texts, "a list of names"),
}
