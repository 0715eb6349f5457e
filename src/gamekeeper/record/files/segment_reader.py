"""Reads a segment up to its end, or up to where it was cut."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import pyarrow as pa

from gamekeeper.errors import BundleError
from gamekeeper.record.files.folder import open_plain, reading
from gamekeeper.record.files.limits import check_growth
from gamekeeper.record.files.messages import (
    PREFIX,
    RECORD_BATCH,
    SCHEMA,
    batch_sizes,
    kind_and_body,
    metadata_size,
)
from gamekeeper.record.files.schema import EXTENSION, check_schema
from gamekeeper.record.files.segments import CRC, END, NO_CRC, Cut

BLANK: Final = "zeros up to the file's end, as a power cut leaves them"
BLOCK_BYTES: Final = 1 << 16
SECTOR_BYTES: Final = 512
"""What a disk writes or doesn't as a whole: bytes never written begin at a multiple of it."""


class SegmentReader:
    """Iterates over the whole batches of a segment; `cut` then says where they ended early.

    Args:
        path: the segment.
        stream: the stream that it belongs to.
        salvage: damage ends the segment as a cut does, in place of raising. Zeros from within a
            message to the file's end are a cut: a power cut left the length without the bytes.
    """

    __slots__ = ("cut", "ended", "path", "salvage", "schema", "stream")

    def __init__(self, path: Path, stream: str, *, salvage: bool = False) -> None:
        self.path, self.stream, self.salvage = path, stream, salvage
        self.schema: pa.Schema | None = None
        self.cut: Cut | None = None
        self.ended = False

    def __iter__(self) -> Iterator[pa.RecordBatch]:
        """Every whole batch, in the order of writing.

        Raises:
            BundleError: bytes are there and wrong (where damage isn't salvaged).
        """
        with open_plain(self.path) as file:
            walk = _Walk(file, os.fstat(file.fileno()).st_size)
            while True:
                try:
                    with reading(self.path):
                        batch = self._next(walk)
                except BundleError as error:
                    with reading(self.path):
                        is_blank = walk.is_blank()
                    if not (self.salvage or is_blank):
                        raise
                    why = BLANK if is_blank else error.seen or error.what
                    self.cut = Cut(self.path.name, walk.offset, why)
                    return
                if batch is None:
                    return
                yield batch

    def _next(self, walk: _Walk) -> pa.RecordBatch | None:
        message = walk.message()
        if message is not None and self.schema is None:
            if message.kind != SCHEMA or message.body:
                raise ValueError("the first message is no schema")
            self.schema = _read_schema(message, self.stream, where=str(self.path))
            walk.accept(message, zlib.crc32(message.data))
            message = walk.message()
        if message is None:
            self.ended = walk.ended
            if walk.missing:
                self.cut = Cut(self.path.name, walk.offset, walk.missing)
            return None
        crc = _check_crc(message, walk.crc)
        check_growth(batch_sizes(message.metadata, message.body)[1], len(message.data))
        batch = pa.ipc.read_record_batch(pa.py_buffer(message.data), self.schema)
        batch.validate(full=True)
        walk.accept(message, crc)
        return batch


@dataclass(frozen=True, slots=True)
class _Message:
    data: bytearray
    metadata: memoryview
    body: memoryview
    kind: int


class _Walk:
    """Goes through a file message by message, never taking more memory than the file has bytes."""

    __slots__ = ("claimed", "crc", "ended", "file", "missing", "offset", "size")

    def __init__(self, file: BinaryIO, size: int) -> None:
        self.file, self.size = file, size
        self.offset, self.crc = 0, 0
        self.claimed = PREFIX  # where the message ends that is being read, as far as it says
        self.ended, self.missing = False, ""

    def message(self) -> _Message | None:
        """The next whole message; None at the end, at a cut (`missing` says of what)."""
        rest = self.size - self.offset
        self.claimed = self.offset + PREFIX
        if rest < PREFIX:
            self.missing = "cut within a message's first bytes" if rest else ""
            return None
        prefix = self._read(PREFIX)
        if prefix == END:
            if rest > PREFIX:
                raise ValueError(f"{rest - PREFIX} bytes after the stream's end")
            self.ended = True
            return None
        head = PREFIX + metadata_size(prefix)
        self.claimed = self.offset + head
        if rest < head:
            self.missing = f"cut: {head - rest} bytes of a message's metadata are missing"
            return None
        data = prefix + self._read(head - PREFIX)
        kind, body_size = kind_and_body(memoryview(data)[PREFIX:])
        self.claimed = self.offset + head + body_size
        if rest < head + body_size:
            self.missing = f"cut: {head + body_size - rest} bytes of a message are missing"
            return None
        data += self._read(body_size)
        view = memoryview(data)
        return _Message(data, view[PREFIX:head], view[head:], kind)

    def is_blank(self) -> bool:
        """Whether from within the message that can't be read the file holds zeros to its end."""
        end = self.size
        while end > self.offset:
            start = max(self.offset, end - BLOCK_BYTES)
            self.file.seek(start)
            written = len(self._read(end - start).rstrip(b"\0"))
            if written:
                end = start + written
                break
            end = start
        border = -(-end // SECTOR_BYTES) * SECTOR_BYTES
        return end <= self.claimed and border < self.size

    def accept(self, message: _Message, crc: int) -> None:
        """The message counts; the next one begins behind it."""
        self.offset += len(message.data)
        self.crc = crc

    def _read(self, size: int) -> bytearray:
        data = bytearray(size)
        view = memoryview(data)
        while view:
            count = self.file.readinto(view)  # type: ignore[attr-defined]
            if not count:
                raise ValueError("the file became shorter while it was read")
            view = view[count:]
        return data


def _read_schema(message: _Message, stream: str, *, where: str) -> pa.Schema:
    # Looked for before Arrow decodes the schema: a type that a package registered runs that
    # package's code as soon as its name is read.
    if EXTENSION in message.data:
        raise ValueError("an Arrow extension type, which a bundle doesn't hold")
    schema = pa.ipc.read_schema(pa.py_buffer(message.data))
    check_schema(schema, stream, where=where)
    return schema


def _check_crc(message: _Message, crc: int) -> int:
    if message.kind != RECORD_BATCH:
        raise ValueError("a message that is no record batch")
    metadata = bytes(message.metadata)
    place = metadata.find(CRC) + len(CRC)
    if place < len(CRC):
        raise ValueError("a batch without its checksum")
    blank = metadata[:place] + NO_CRC + metadata[place + len(NO_CRC) :]
    crc = zlib.crc32(message.data[:PREFIX], crc)
    crc = zlib.crc32(message.body, zlib.crc32(blank, crc))
    if metadata[place : place + len(NO_CRC)] != b"%08x" % crc:
        raise ValueError("a batch whose checksum doesn't fit its bytes")
    return crc
