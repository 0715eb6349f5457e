"""annotations.jsonl: labels and diagnoses, added line by line, never changed.

Every line is a JSON object whose `prev` is the digest of the line before it (zeros in the first),
so that a changed, inserted or removed line breaks the chain. Lines taken off the end leave no trace
in the chain itself: for that, compare its last digest with one kept elsewhere.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import BundleError, EvidenceError
from gamekeeper.record.files.folder import (
    NO_FOLLOW,
    inside,
    read_bounded,
    reading,
    system_error,
    take_lock,
    write_all,
)
from gamekeeper.record.files.manifest import load_manifest

NOTES: Final = "annotations.jsonl"
NOTES_BYTES: Final = 1 << 30
BLOCK_BYTES: Final = 1 << 16
FIRST: Final = "0" * 64


def annotate(path: str | PathLike[str], record: dict[str, Any]) -> None:
    """Adds a line to a bundle's annotations, whether it is sealed or not.

    Args:
        path: the folder of the bundle.
        record: plain JSON; the name `prev` is the chain's own.
    Raises:
        EvidenceError: the record isn't plain JSON, or has a field `prev`.
        BundleError: there is no bundle, the last line is damaged, or the disk refuses.
    """
    folder = Path(path)
    with reading(folder):
        load_manifest(folder)
    add_note(folder, record)


def add_note(folder: Path, record: dict[str, Any]) -> None:
    """Adds a line to the annotations in a folder that is known to be a bundle; see `annotate`."""
    _check_record(record)
    path = inside(folder, NOTES)
    flags = os.O_RDWR | os.O_CREAT | NO_FOLLOW | getattr(os, "O_BINARY", 0)
    try:
        descriptor = os.open(path, flags, 0o666)
    except OSError as error:
        raise system_error(f"opening {NOTES}", path, error) from error
    try:
        take_lock(descriptor, wait=True)
        _append(descriptor, record, path)
    except OSError as error:
        if isinstance(error, BundleError):
            raise
        raise system_error(f"writing {NOTES}", path, error) from error
    finally:
        os.close(descriptor)


def read_notes(path: str | PathLike[str]) -> tuple[dict[str, Any], ...]:
    """The annotations of a bundle in the order of writing, without the chain's own field.

    Raises:
        BundleError: a line is damaged, or the chain is broken.
    """
    notes = []
    with reading(Path(path)):
        lines = list(chain(Path(path)))
    for number, note, why in lines:
        if note is None or why:
            raise BundleError(
                f"line {number} of {NOTES} {why}",
                where=str(Path(path) / NOTES),
                mend="restore the file from a copy; `gamekeeper verify` lists all damage",
            )
        notes.append({key: value for key, value in note.items() if key != "prev"})
    return tuple(notes)


def chain(folder: Path) -> Iterator[tuple[int, dict[str, Any] | None, str]]:
    """Each line's number, what it says (None where it says nothing), and what is wrong with it."""
    path = inside(folder, NOTES)
    if not path.exists():
        return
    expected = FIRST
    lines = read_bounded(path, NOTES_BYTES).split(b"\n")
    if lines and not lines[-1]:
        lines.pop()
    for number, line in enumerate(lines, start=1):
        note = _parse(line)
        why = ""
        if note is None:
            why = "is no JSON object"
        elif note.get("prev") != expected:
            why = "doesn't follow the line before it"
        yield number, note, why
        expected = _digest(line)


def _check_record(record: dict[str, Any]) -> None:
    if not isinstance(record, dict) or "prev" in record:
        raise EvidenceError(
            "an annotation must be an object without a field 'prev'",
            where=NOTES,
            seen=repr(record)[:100],
            mend="name the field differently: 'prev' holds the digest of the line before",
        )
    _spell(record)


def _spell(record: dict[str, Any]) -> bytes:
    try:
        text = json.dumps(record, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise EvidenceError(
            "an annotation can't be written as JSON",
            where=NOTES,
            seen=str(error),
            mend="encode NaN, infinities, bytes and objects as text first",
        ) from error
    return text.encode("ascii")


def _append(descriptor: int, record: dict[str, Any], path: Path) -> None:
    end = os.fstat(descriptor).st_size
    tail, start = _last_line(descriptor, end)
    if tail and not tail.endswith(b"\n"):
        if _parse(tail) is None:
            # A line that was never finished (the process was killed in it) was never said.
            os.ftruncate(descriptor, start)
            tail, start = _last_line(descriptor, start)
            end = os.fstat(descriptor).st_size
        else:
            _put(descriptor, b"\n")
            end, tail = end + 1, tail + b"\n"
    if tail and _parse(tail[:-1]) is None:
        raise BundleError(
            f"the last line of {NOTES} is damaged",
            where=str(path),
            mend="restore the file from a copy, then annotate again",
        )
    line = _spell({**record, "prev": _digest(tail[:-1]) if tail else FIRST}) + b"\n"
    try:
        _put(descriptor, line)
    except OSError:
        os.ftruncate(descriptor, end)
        raise


def _put(descriptor: int, data: bytes) -> None:
    """The bytes follow what the file holds, and survive a power cut."""
    os.lseek(descriptor, 0, os.SEEK_END)
    write_all(descriptor, data)
    os.fsync(descriptor)


def _last_line(descriptor: int, end: int) -> tuple[bytes, int]:
    """The bytes after the last line's end but one, and where they start."""
    tail, start = b"", end
    while start > 0 and b"\n" not in tail[:-1]:
        size = min(BLOCK_BYTES, start)
        start -= size
        os.lseek(descriptor, start, os.SEEK_SET)
        tail = os.read(descriptor, size) + tail
    cut = tail[:-1].rfind(b"\n") + 1
    return tail[cut:], start + cut


def _parse(line: bytes) -> dict[str, Any] | None:
    try:
        note = json.loads(line.decode("ascii"))
    except (ValueError, RecursionError):
        return None
    return note if isinstance(note, dict) else None


def _digest(line: bytes) -> str:
    return hashlib.blake2b(line, digest_size=32).hexdigest()
