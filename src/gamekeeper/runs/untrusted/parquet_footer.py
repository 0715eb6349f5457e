"""The footer of a Parquet file, read by hand.

Arrow's own view of a footer can't be asked for this: on some damaged footers it ends the process
instead of raising. Only sizes are read here; Arrow itself decodes.

Source: Apache Thrift compact protocol; parquet-format 2.11, parquet.thrift.
"""

import struct
from dataclasses import dataclass
from typing import Any, BinaryIO, Final

ARROW_SCHEMA: Final = b"ARROW:schema"
MAGIC: Final = b"PAR1"
TAIL: Final = 8  # bytes: the footer's size and the magic
FOOTER_BYTES: Final = 1 << 28
DEPTH: Final = 16  # of structs in structs; the format has 6
BYTE_ARRAY: Final = 6  # parquet.thrift, enum Type

Fields = dict[int, Any]


@dataclass(frozen=True, slots=True)
class ColumnChunk:
    """One column of one row group.

    Args:
        path: the column's name, with a dot before each level of nesting.
        kind: its physical type, as numbered in parquet.thrift.
        values: number of its values, nulls included.
        size_bytes: of its pages before compression.
        has_dictionary: its values may stand in a dictionary.
    """

    path: str
    kind: int
    values: int
    size_bytes: int
    has_dictionary: bool


@dataclass(frozen=True, slots=True)
class Footer:
    """Sizes and schema of a file, known before Arrow opens it.

    Args:
        groups: of each row group, the number of rows and the chunks.
        arrow_schema: the Arrow schema that the writer stored, as its base64; empty if it didn't.
    """

    groups: tuple[tuple[int, list[ColumnChunk]], ...]
    arrow_schema: bytes


def read_footer(file: BinaryIO, size: int) -> Footer:
    """The footer of a Parquet file.

    Raises:
        ValueError: the footer isn't one.
    """
    if size < len(MAGIC) + TAIL:
        raise ValueError("too short for a Parquet file")
    file.seek(size - TAIL)
    tail = file.read(TAIL)
    (length,) = struct.unpack_from("<I", tail)
    if tail[4:] != MAGIC:
        raise ValueError("no Parquet file: it doesn't end with PAR1")
    if length > min(size - TAIL - len(MAGIC), FOOTER_BYTES):
        raise ValueError(f"a footer of {length} bytes in a file of {size}")
    file.seek(size - TAIL - length)
    footer = _Thrift(file.read(length)).fields(DEPTH)
    pairs = [_struct(pair) for pair in _list(footer, 5)] if 5 in footer else []
    schemas = [pair.get(2) for pair in pairs if pair.get(1) == ARROW_SCHEMA] or [b""]
    if len(schemas) > 1 or not isinstance(schemas[0], bytes):
        raise ValueError("a footer with two schemas, or with none where one should be")
    groups = [
        (_count(group, 3), [_chunk(chunk) for chunk in _list(group, 1)])
        for group in _list(footer, 4)
    ]
    return Footer(tuple(groups), schemas[0])


def _chunk(chunk: Any) -> ColumnChunk:
    if 1 in _struct(chunk):
        raise ValueError("a column that stands in another file")
    column = _struct(chunk.get(3))
    path = [part.decode("utf-8") for part in _list(column, 3) if isinstance(part, bytes)]
    return ColumnChunk(
        path=".".join(path),
        kind=_count(column, 1),
        values=_count(column, 5),
        size_bytes=_count(column, 6),
        has_dictionary=11 in column,
    )


def _struct(value: Any) -> Fields:
    if not isinstance(value, dict):
        raise ValueError("a footer of another shape")
    return value


def _list(fields: Any, number: int) -> list[Any]:
    value = _struct(fields).get(number)
    if not isinstance(value, list):
        raise ValueError("a footer of another shape")
    return value


def _count(fields: Any, number: int) -> int:
    value = _struct(fields).get(number)
    if type(value) is not int or value < 0:
        raise ValueError("a footer of another shape")
    return value


class _Thrift:
    """Thrift's compact protocol: structs become dictionaries by field number."""

    def __init__(self, data: bytes) -> None:
        self.data, self.place = data, 0

    def fields(self, depth: int) -> Fields:
        found: Fields = {}
        number = 0
        while kind := self._byte():
            number = number + (kind >> 4) if kind >> 4 else self._signed()
            kind &= 15
            # A truth value stands in the type itself: 1 for true, 2 for false.
            found[number] = kind == 1 if kind in (1, 2) else self._value(kind, depth)
        return found

    def _value(self, kind: int, depth: int) -> Any:
        if kind in (4, 5, 6):  # i16, i32, i64
            return self._signed()
        if kind == 8:
            return self._bytes(self._unsigned())
        if kind in (9, 10):  # list, set
            return self._items(depth - 1)
        if kind == 12 and depth:
            return self.fields(depth - 1)
        if kind in (1, 2, 3):  # a truth value in a list, or i8
            return self._byte()
        if kind == 7:
            return self._bytes(8)
        raise ValueError(f"a footer with a value of type {kind} or nested too deep")

    def _items(self, depth: int) -> list[Any]:
        head = self._byte()
        count = head >> 4
        if count == 15:
            count = self._unsigned()
        if depth < 0 or count > len(self.data) - self.place:
            raise ValueError("a footer that lists more than it holds")
        return [self._value(head & 15, depth) for _ in range(count)]

    def _bytes(self, size: int) -> bytes:
        if size > len(self.data) - self.place:
            raise ValueError("a footer that ends within a value")
        self.place += size
        return self.data[self.place - size : self.place]

    def _byte(self) -> int:
        try:
            value = self.data[self.place]
        except IndexError:
            raise ValueError("a footer that ends within a value") from None
        self.place += 1
        return value

    def _unsigned(self) -> int:
        value = self._byte()
        if value < 128:  # most are: a query opens thousands of footers
            return value
        value, shift = value & 127, 7
        while (byte := self._byte()) & 128:
            value |= (byte & 127) << shift
            shift += 7
            if shift > 63:
                raise ValueError("a footer with a number of more than 64 bits")
        return value | byte << shift

    def _signed(self) -> int:
        value = self._unsigned()
        return value >> 1 ^ -(value & 1)
