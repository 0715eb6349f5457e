"""The frames of an Arrow IPC stream, read by hand.

Only what bounds memory is read here; Arrow itself decodes.

Source: Arrow columnar format 1.5, "Encapsulated message format" and Message.fbs, Schema.fbs.
"""

import struct
from typing import Final

PREFIX: Final = 8  # bytes: the continuation mark and the size of the metadata
MARK: Final = b"\xff\xff\xff\xff"
SCHEMA: Final = 1  # MessageHeader in Message.fbs
RECORD_BATCH: Final = 3
BATCH_ROWS: Final = 1 << 27
COLUMNS: Final = 1 << 16

Bytes = bytes | bytearray | memoryview


def metadata_size(prefix: Bytes) -> int:
    """Bytes of metadata that a message's first eight bytes announce; 0 at a stream's end.

    Raises:
        ValueError: no message of the format begins like this.
    """
    if prefix[:4] != MARK:
        raise ValueError("no message begins here")
    size = _number(prefix, 4, "<i")
    if size < 0 or size % 8:
        raise ValueError(f"a message announces {size} bytes of metadata")
    return size


def kind_and_body(metadata: Bytes) -> tuple[int, int]:
    """Kind of a message (SCHEMA, RECORD_BATCH, other) and number of bytes in its body.

    Raises:
        ValueError: the metadata is no Message.
    """
    message = _number(metadata, 0, "<I")
    kind = _field(metadata, message, 1)
    body = _field(metadata, message, 3)
    size = _number(metadata, body, "<q") if body else 0
    if size < 0:
        raise ValueError(f"a message announces a body of {size} bytes")
    return (metadata[kind] if kind else 0), size


def batch_sizes(metadata: Bytes, body: Bytes) -> tuple[int, int]:
    """Rows of a record batch, and the bytes that its buffers take once decompressed.

    Raises:
        ValueError: the metadata describes no batch that fits its body.
    """
    message = _number(metadata, 0, "<I")
    header = _field(metadata, message, 2)
    if not header:
        raise ValueError("a message without a header")
    batch = header + _number(metadata, header, "<I")
    length = _field(metadata, batch, 0)
    rows = _number(metadata, length, "<q") if length else 0
    if not 0 <= rows <= BATCH_ROWS:
        raise ValueError(f"a batch announces {rows} rows")
    is_compressed = _field(metadata, batch, 3) != 0
    vector = _field(metadata, batch, 2)
    if not vector:
        return rows, 0
    start = vector + _number(metadata, vector, "<I")
    count = _number(metadata, start, "<I")
    if count > COLUMNS * 4:
        raise ValueError(f"a batch announces {count} buffers")
    pairs = struct.unpack_from(f"<{2 * count}q", metadata, start + 4)
    return rows, sum(
        _decoded(body, offset, size, is_compressed)
        for offset, size in zip(pairs[::2], pairs[1::2], strict=True)
    )


def _decoded(body: Bytes, offset: int, size: int, is_compressed: bool) -> int:
    if offset < 0 or size < 0 or offset + size > len(body):
        raise ValueError("a buffer lies outside its message")
    if not is_compressed or size == 0:
        return size
    if size < 8:
        raise ValueError("a compressed buffer without its length")
    length = _number(body, offset, "<q")
    if length < -1:
        raise ValueError(f"a buffer announces {length} bytes")
    return size - 8 if length == -1 else length


def _field(data: Bytes, table: int, index: int) -> int:
    """Place of a field of a flatbuffer's table, 0 where it is left out."""
    vtable = table - _number(data, table, "<i")
    if vtable < 0:
        raise ValueError("a table before the message's begin")
    slot = 4 + 2 * index  # after the sizes of the vtable and of the table
    if slot + 2 > _number(data, vtable, "<H"):
        return 0
    offset = _number(data, vtable + slot, "<H")
    place = table + offset if offset else 0
    if place >= len(data):
        raise ValueError("a field outside its message")
    return int(place)


def _number(data: Bytes, place: int, form: str) -> int:
    """The number at a place, of a form of `struct`."""
    return int(struct.unpack_from(form, data, place)[0])
