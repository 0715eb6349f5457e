"""Arrays that grow part by part on disk and become one .npz file, so that memory stays flat."""

from __future__ import annotations

import io
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from gamekeeper.errors import EvidenceError
from gamekeeper.runs.files.folder import system_error

BUDGET_BYTES: Final = 32 << 20  # of parts that wait in memory, of all arrays together
PART_BYTES: Final = 200  # of an array object, beside its elements: parts are often small
COPY_BYTES: Final = 1 << 20
EPOCH: Final = (1980, 1, 1, 0, 0, 0)  # the oldest time of a zip: equal evidence, equal bytes
EXTENT: Final = 1 << 31  # of a member: beyond it zip needs its longer form


class Spool:
    """Arrays by name, each growing along its first axis; in `folder` where memory is short."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._kinds: dict[str, tuple[np.dtype[Any], tuple[int, ...]]] = {}
        self._places: dict[str, int] = {}
        self._rows: dict[str, int] = {}
        self._waiting: dict[str, list[Any]] = {}
        self._waiting_bytes = 0
        self._text: dict[str, str] = {}

    def add_text(self, name: str, text: str) -> None:
        """Adds one text, as an array of no dimensions."""
        self._text[name] = text

    def add(self, name: str, part: Any) -> None:
        """Appends rows to an array.

        Raises:
            EvidenceError: they have another dtype or shape than the array.
        """
        part = np.asarray(part)
        kind = part.dtype.newbyteorder("<"), part.shape[1:]
        known = self._kinds.setdefault(name, kind)
        if known != kind:
            raise EvidenceError(
                "an array changes its form",
                where=name,
                expected=f"{known[0]} {list(known[1])}",
                actual=f"{kind[0]} {list(kind[1])}",
                fix="export runs of one environment only, whose spaces stay the same",
            )
        self._places.setdefault(name, len(self._places))
        self._rows[name] = self._rows.get(name, 0) + len(part)
        self._waiting.setdefault(name, []).append(part.astype(kind[0], copy=False))
        self._waiting_bytes += part.nbytes + PART_BYTES
        if self._waiting_bytes >= BUDGET_BYTES:
            self._flush()

    def length(self, name: str) -> int:
        """Number of rows that an array has so far."""
        return self._rows.get(name, 0)

    def write(self, target: BinaryIO, *, compress: bool) -> None:
        """Writes all arrays as one .npz file."""
        self._flush()
        method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
        with zipfile.ZipFile(target, "w", method, allowZip64=True, compresslevel=1) as archive:
            for name, text in self._text.items():
                array = np.array(text)
                data = _header(array.dtype, ()) + array.tobytes()
                archive.writestr(_entry(name, method), data)
            # by name: which of them came first depends on the parts in which rows are read
            for name, (dtype, shape) in sorted(self._kinds.items(), key=itemgetter(0)):
                whole = (self._rows[name], *shape)
                is_long = int(np.prod(whole, dtype=np.int64)) * dtype.itemsize >= EXTENT
                with archive.open(_entry(name, method), "w", force_zip64=is_long) as member:
                    member.write(_header(dtype, whole))
                    path = self._path(name)
                    if path.exists():  # else it has no rows
                        with path.open("rb") as file:
                            shutil.copyfileobj(file, member, COPY_BYTES)

    def _flush(self) -> None:
        for name, parts in self._waiting.items():
            with self._path(name).open("ab") as file:
                for part in parts:
                    file.write(np.ascontiguousarray(part).tobytes())
        self._waiting.clear()
        self._waiting_bytes = 0

    def _path(self, name: str) -> Path:
        return self._folder / str(self._places[name])


@contextmanager
def spooled(path: Path, *, compress: bool) -> Iterator[Spool]:
    """Gives a spool that becomes the .npz file at `path` when the block ends without an error.

    Raises:
        RunError: the disk refuses.
    """
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
            spool = Spool(Path(folder))
            yield spool
            draft = Path(folder) / "draft"
            with draft.open("wb") as target:
                spool.write(target, compress=compress)
                target.flush()
                os.fsync(target.fileno())
            draft.replace(path)
    except OSError as error:
        if isinstance(error, EvidenceError):
            raise
        raise system_error(f"writing {path.name}", path, error) from error


def _entry(name: str, method: int) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(f"{name}.npy", EPOCH)
    entry.compress_type = method
    return entry


def _header(dtype: np.dtype[Any], shape: tuple[int, ...]) -> bytes:
    buffer = io.BytesIO()
    described = {"descr": dtype.str, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(buffer, described)
    return buffer.getvalue()
