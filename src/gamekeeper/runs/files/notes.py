"""annotations.jsonl: labels and diagnoses, added line by line, never changed.

Every line is a JSON object whose `digest` is that of the digest before it (zeros in the first) and
of the line itself, so that a changed, inserted or removed line breaks the chain. Lines taken off
the end leave no episode in the chain. Annotations are no part of the root digest, which stays as it
was when the run was finalized.
"""

import hashlib
import json
import os
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.runs.files.folder import (
    NO_FOLLOW,
    inside,
    read_bounded,
    reading,
    system_error,
    take_lock,
    write_all,
)
from gamekeeper.runs.files.manifest import load_manifest

NOTES: Final = "annotations.jsonl"
NOTES_BYTES: Final = 1 << 30
BLOCK_BYTES: Final = 1 << 16
FIRST: Final = "0" * 64
DIGEST: Final = "digest"
"""The field that a line's digest stands in."""


def annotate(path: str | PathLike[str], record: dict[str, Any]) -> None:
    """Adds a line to a run's annotations, whether it is finalized or not.

    Args:
        record: plain JSON; the name `digest` is the chain's own.
    Raises:
        EvidenceError: the record isn't plain JSON, or has a field `digest`.
        RunError: there is no run, the last line is damaged, or the disk refuses.
    """
    folder = Path(path)
    with reading(folder):
        load_manifest(folder)
    add_note(folder, record)


def add_note(folder: Path, record: dict[str, Any]) -> None:
    """Adds a line to the annotations in a folder that is known to be a run; see `annotate`."""
    if not isinstance(record, dict) or DIGEST in record:
        raise EvidenceError(
            f"an annotation must be an object without a field {DIGEST!r}",
            where=NOTES,
            actual=repr(record)[:100],
            fix=f"name the field differently: {DIGEST!r} holds the line's own digest",
        )
    _spell(record)  # raises before the file is touched
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
        if isinstance(error, RunError):
            raise
        raise system_error(f"writing {NOTES}", path, error) from error
    finally:
        os.close(descriptor)


def read_notes(path: str | PathLike[str]) -> tuple[dict[str, Any], ...]:
    """The annotations of a run in the order of writing, without the chain's own field.

    Raises:
        RunError: a line is damaged, or the chain is broken.
    """
    notes = []
    with reading(Path(path)):
        lines = list(chain(Path(path)))
    for number, note, why in lines:
        if note is None or why:
            raise RunError(
                f"line {number} of {NOTES} {why}",
                where=str(Path(path) / NOTES),
                fix="restore the file from a copy; `gamekeeper verify` lists all damage",
            )
        notes.append({key: value for key, value in note.items() if key != DIGEST})
    return tuple(notes)


def chain(folder: Path) -> Iterator[tuple[int, dict[str, Any] | None, str]]:
    """Yields each line's number, its record (None if it has none), and its fault in words."""
    path = inside(folder, NOTES)
    if not path.exists():
        return
    before = FIRST
    *lines, rest = read_bounded(path, NOTES_BYTES).split(b"\n")
    is_torn = bool(rest)
    if is_torn:
        lines.append(rest)
    for number, line in enumerate(lines, start=1):
        note = _parse(line)
        why = ""
        if note is None:
            why = "is no JSON object"
        elif line != _line(before, note):
            why = "isn't as it was written, or doesn't follow the line before it"
        elif is_torn and number == len(lines):
            why = "was never finished"
        yield number, note, why
        before = "" if note is None else str(note.get(DIGEST))


def _spell(record: dict[str, Any]) -> bytes:
    try:
        text = json.dumps(record, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise EvidenceError(
            "an annotation can't be written as JSON",
            where=NOTES,
            actual=str(error),
            fix="encode NaN, infinities, bytes and objects as text first",
        ) from error
    return text.encode("ascii")


def _append(descriptor: int, record: dict[str, Any], path: Path) -> None:
    end = os.fstat(descriptor).st_size
    tail, start = _last_line(descriptor, end)
    if tail and not tail.endswith(b"\n"):
        if _parse(tail) is None:
            # a line that was never finished (the process was killed in it) doesn't count
            os.ftruncate(descriptor, start)
            tail, start = _last_line(descriptor, start)
            end = os.fstat(descriptor).st_size
        else:
            _put(descriptor, b"\n")
            end, tail = end + 1, tail + b"\n"
    last = _parse(tail[:-1]) if tail else {DIGEST: FIRST}
    if last is None or not isinstance(last.get(DIGEST), str):
        raise RunError(
            f"the last line of {NOTES} is damaged",
            where=str(path),
            fix="restore the file from a copy, then annotate again",
        )
    try:
        _put(descriptor, _line(last[DIGEST], record) + b"\n")
    except OSError:
        os.ftruncate(descriptor, end)
        raise


def _put(descriptor: int, data: bytes) -> None:
    """Appends the bytes to the file; they survive a power cut."""
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
        if not isinstance(note, dict):
            return None
        _spell(note)  # Python's JSON reads NaN and infinities, which no line holds
    except (ValueError, RecursionError):
        return None
    return note


def _line(before: str, note: dict[str, Any]) -> bytes:
    """The one spelling of a line that follows the digest `before`, its own digest in it."""
    record = {key: value for key, value in note.items() if key != DIGEST}
    digest = hashlib.blake2b(before.encode() + _spell(record), digest_size=32).hexdigest()
    return _spell({**record, DIGEST: digest})
