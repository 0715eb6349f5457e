"""Writes a segment: whole batches, handed to the operating system one by one."""

from __future__ import annotations

import os
import zlib
from pathlib import Path
from typing import Final

import pyarrow as pa

from gamekeeper.record.files.folder import NEW_FLAGS, system_error, write_all
from gamekeeper.record.files.messages import (
    PREFIX,
    metadata_size,
)
from gamekeeper.record.files.segments import CRC, END, NO_CRC

# Below it zstd's 20 us a column don't pay: the Parquet file compresses all of it anyway.
WORTH_BYTES: Final = 1 << 18


class SegmentWriter:
    """Appends batches of one schema to a new file; after `write` returns no kill loses them."""

    __slots__ = ("_crc", "_descriptor", "_large", "_small", "path", "schema", "size")

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
        """The batch is with the operating system, whole.

        Raises:
            BundleError: the disk refuses; the file then ends with the last whole batch.
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
        """The file ends with the mark that nothing follows, and is closed."""
        try:
            if self.size:
                self._put(END, self._crc)
        finally:
            self.close()

    def close(self) -> None:
        """The file is closed as it is."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _put(self, data: bytes | bytearray, crc: int) -> None:
        """All of it is in the file, or nothing: also where Ctrl-C comes in the middle."""
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
