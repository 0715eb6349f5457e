"""Segments: Arrow streams that hold every appended batch even when the process is killed."""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import pyarrow as pa

from gamekeeper.errors import RunError
from gamekeeper.runs.files.folder import NEW_FLAGS, open_plain, reading, system_error, write_all
from gamekeeper.runs.files.schema import EXTENSION, check_schema
from gamekeeper.runs.untrusted.arrow_messages import (
    PREFIX,
    RECORD_BATCH,
    SCHEMA,
    batch_sizes,
    kind_and_body,
    metadata_size,
)
from gamekeeper.runs.untrusted.limits import check_growth

# -- Segments: Arrow IPC streams that hold every appended batch even when the process is killed
#
# A segment is an ordinary Arrow IPC stream (any Arrow library reads it): one schema message,
# record batches compressed with zstd, and at its regular end the end-of-stream mark. Each batch
# message carries in its metadata a CRC-32 over the messages so far, so that a cut (bytes missing
# at the end, what a kill or a full disk leaves) can be told from damage (bytes that are there and
# wrong).
#
# Nothing waits in the process, so no kill of it loses a batch. Segments are not synced: a power cut
# may take what the system had not written yet (Linux writes it after 30 s at the latest). What it
# leaves is told from damage as well: a file that is shorter, or holds zeros from some sector on.

END: Final = b"\xff\xff\xff\xff\x00\x00\x00\x00"
CRC: Final = b"gamekeeper.crc32="
NO_CRC: Final = b"00000000"
JOURNAL: Final = "journal.msgpack"  # goes on where the segments end
SEGMENT: Final = re.compile(r"(episodes|agent_steps|states|timings)-(\d{4,9})\.arrows")


@dataclass(frozen=True, slots=True)
class Cut:
    """Place where a file's whole content ends before the file or the stream does, and why."""

    file: str
    offset: int
    why: str


def segment_name(stream: str, number: int) -> str:
    """The name of a stream's segment in the run's folder."""
    return f"{stream}-{number:04d}.arrows"


# -- Writes a segment: whole batches, handed to the operating system one by one

# Below it zstd's 20 us a column don't pay: the Parquet file compresses all of it anyway.
WORTH_BYTES: Final = 1 << 20


class SegmentWriter:
    """Appends batches of one schema to a new file; after `write` returns no kill loses them."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self.path, self.schema = path, schema
        self.size = 0  # bytes in the file
        self._crc = 0
        # The writer's thread is the one that may use a second core: a pool of threads for a batch
        # of some hundred kB takes more from the environment than it gives.
        self._large = pa.ipc.IpcWriteOptions(
            compression=pa.Codec("zstd", compression_level=1), use_threads=False
        )
        self._small = pa.ipc.IpcWriteOptions(use_threads=False)
        try:
            self._descriptor = os.open(path, NEW_FLAGS, 0o666)
        except OSError as error:
            raise system_error(f"starting {path.name}", path, error) from error

    def write(self, batch: pa.RecordBatch) -> None:
        """Hands the batch to the operating system, whole.

        Raises:
            RunError: the disk refuses; the file then ends with the last whole batch.
        """
        sink = pa.BufferOutputStream()
        options = self._large if batch.nbytes >= WORTH_BYTES else self._small
        with pa.ipc.new_stream(sink, self.schema, options=options) as writer:
            writer.write_batch(batch, custom_metadata={CRC[:-1]: CRC + NO_CRC})
        stream = memoryview(sink.getvalue()).cast("B")[: -len(END)]
        head = PREFIX + metadata_size(stream[:PREFIX])  # a schema message has no body
        crc = self._crc if self.size else zlib.crc32(stream[:head])
        message = bytearray(stream[head:])
        crc = zlib.crc32(message, crc)
        place = message.index(CRC) + len(CRC)
        message[place : place + len(NO_CRC)] = b"%08x" % crc
        self._put(message if self.size else bytes(stream[:head]) + message, crc)

    def finish(self) -> None:
        """Ends the file with the mark that nothing follows, and closes it."""
        try:
            if self.size:
                self._put(END, self._crc)
        finally:
            self.close()

    def close(self) -> None:
        """Closes the file as it is."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _put(self, data: bytes | bytearray, crc: int) -> None:
        """Puts all of it into the file, or nothing: also where Ctrl-C comes in the middle."""
        size = self.size + len(data)
        try:
            write_all(self._descriptor, data)
            self.size, self._crc = size, crc
        except BaseException as error:
            os.ftruncate(self._descriptor, self.size)
            os.lseek(self._descriptor, self.size, os.SEEK_SET)
            if isinstance(error, OSError):
                raise system_error(f"writing {self.path.name}", self.path, error) from error
            raise


# -- Reads a segment up to its end, or up to where it was cut

BLANK: Final = "zeros up to the file's end, as a power cut leaves them"
BLOCK_BYTES: Final = 1 << 16
SECTOR_BYTES: Final = 512
"""Bytes that a disk writes as a whole or not: bytes never written begin at a multiple of it."""


class SegmentReader:
    """Iterates over the whole batches of a segment; `cut` names the place where they ended early.

    It goes message by message and never takes more memory than the file has bytes.

    Args:
        stream: the stream that it belongs to.
        salvage: damage ends the segment as a cut does, in place of raising. Zeros from within a
            message to the file's end are a cut: a power cut left the length without the bytes.
    """

    def __init__(self, path: Path, stream: str, *, salvage: bool = False) -> None:
        self.path, self.stream, self.salvage = path, stream, salvage
        self.schema: pa.Schema | None = None
        self.cut: Cut | None = None
        self.ended = False
        self._size = self._offset = self._crc = 0
        self._claimed = PREFIX  # where the message ends that is being read, by its own account

    def __iter__(self) -> Iterator[pa.RecordBatch]:
        """Every whole batch, in the order of writing.

        Raises:
            RunError: bytes are there and wrong (where damage isn't salvaged).
        """
        with open_plain(self.path) as file:
            self._size = os.fstat(file.fileno()).st_size
            while True:
                try:
                    with reading(self.path):
                        batch = self._next(file)
                except RunError as error:
                    with reading(self.path):
                        is_blank = self._is_blank(file)
                    if not (self.salvage or is_blank):
                        raise
                    why = BLANK if is_blank else error.actual or error.what
                    self.cut = Cut(self.path.name, self._offset, why)
                    return
                if batch is None:
                    return
                yield batch

    def _next(self, file: BinaryIO) -> pa.RecordBatch | None:
        message = self._message(file)
        if message is not None and self.schema is None:
            if message.kind != SCHEMA or message.body:
                raise ValueError("the first message is no schema")
            # Looked for before Arrow decodes the schema: a type that a package registered runs
            # that package's code as soon as its name is read.
            if EXTENSION in message.data:
                raise ValueError("an Arrow extension type, which a run doesn't hold")
            self.schema = pa.ipc.read_schema(pa.py_buffer(message.data))
            check_schema(self.schema, self.stream, where=str(self.path))
            self._accept(message, zlib.crc32(message.data))
            message = self._message(file)
        if message is None:
            return None
        crc = _check_crc(message, self._crc)
        check_growth(batch_sizes(message.metadata, message.body)[1], len(message.data))
        batch = pa.ipc.read_record_batch(pa.py_buffer(message.data), self.schema)
        batch.validate(full=True)
        self._accept(message, crc)
        return batch

    def _message(self, file: BinaryIO) -> _Message | None:
        """The next whole message; None at the end, or at a cut."""
        rest = self._size - self._offset
        self._claimed = self._offset + PREFIX
        if rest < PREFIX:
            return self._cut_off("cut within a message's first bytes" if rest else "")
        prefix = _read(file, PREFIX)
        if prefix == END:
            if rest > PREFIX:
                raise ValueError(f"{rest - PREFIX} bytes after the stream's end")
            self.ended = True
            return None
        head = PREFIX + metadata_size(prefix)
        self._claimed = self._offset + head
        if rest < head:
            return self._cut_off(f"cut: {head - rest} bytes of a message's metadata are missing")
        data = prefix + _read(file, head - PREFIX)
        kind, body_size = kind_and_body(memoryview(data)[PREFIX:])
        self._claimed = self._offset + head + body_size
        if rest < head + body_size:
            return self._cut_off(f"cut: {head + body_size - rest} bytes of a message are missing")
        data += _read(file, body_size)
        view = memoryview(data)
        return _Message(data, view[PREFIX:head], view[head:], kind)

    def _cut_off(self, why: str) -> _Message | None:
        """Ends the segment here; it was cut if `why` isn't empty."""
        self.cut = Cut(self.path.name, self._offset, why) if why else None
        return None

    def _is_blank(self, file: BinaryIO) -> bool:
        """True if from within the message that can't be read the file holds zeros to its end."""
        end = self._size
        while end > self._offset:
            start = max(self._offset, end - BLOCK_BYTES)
            file.seek(start)
            written = len(_read(file, end - start).rstrip(b"\0"))
            if written:
                end = start + written
                break
            end = start
        # a disk writes whole sectors: bytes that were never written begin at a border of two
        border = -(-end // SECTOR_BYTES) * SECTOR_BYTES
        return end <= self._claimed and border < self._size

    def _accept(self, message: _Message, crc: int) -> None:
        """Counts the message; the next one begins behind it."""
        self._offset += len(message.data)
        self._crc = crc


@dataclass(frozen=True, slots=True)
class _Message:
    data: bytearray
    metadata: memoryview
    body: memoryview
    kind: int


def _read(file: BinaryIO, size: int) -> bytearray:
    data = bytearray(size)
    view = memoryview(data)
    while view:
        count = file.readinto(view)  # type: ignore[attr-defined]
        if not count:
            raise ValueError("the file became shorter while it was read")
        view = view[count:]
    return data


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
