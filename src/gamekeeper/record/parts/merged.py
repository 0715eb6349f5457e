"""That parts are merged is noted beside them, just before their bundle takes its place.

Between the two and the end of the command a process may die. The note names the bundle by its seal,
so that the same command knows its own work from anything else that lies there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import GamekeeperError
from gamekeeper.record.files.manifest import load_manifest
from gamekeeper.record.parts.plan import MERGED, Plan, digest_of
from gamekeeper.run.executors.storage import Storage

NOTE_BYTES: Final = 1 << 20
"""Most that a note may hold: a digest each, and the fields of an error."""


@dataclass(frozen=True, slots=True)
class Merged:
    """A bundle that was merged before.

    Attributes:
        parts: how many are in it.
        error: of the first episode that failed; None where none did.
    """

    parts: int
    error: GamekeeperError | None


def note_merged(
    storage: Storage, plan: Plan, sealed: Path, *, parts: int, ended: Mapping[str, str] | None
) -> None:
    """The storage says which bundle is about to take its place.

    Args:
        sealed: the bundle, where it lies yet.
        ended: fields of the error of the first episode that failed.
    Raises:
        BundleError: the storage refuses.
    """
    note = {
        "plan": digest_of(plan), "seal": _seal(sealed), "parts": parts,
        "error": None if ended is None else dict(ended),
    }  # fmt: skip
    storage.put(MERGED, json.dumps(note).encode())


def found_merged(storage: Storage, plan: Plan, out: Path) -> Merged | None:
    """What is known of the bundle `out`, if it is the one that this plan's parts were merged into.

    Raises:
        BundleError: the storage refuses.
    """
    seal = _seal(out)
    if seal is None or not storage.exists(MERGED):
        return None
    note = _read(storage.get(MERGED, most_bytes=NOTE_BYTES))
    if (note.get("plan"), note.get("seal")) != (digest_of(plan), seal):
        return None
    from gamekeeper.record.tasks import error_of

    ended = note["error"]
    return Merged(note["parts"], None if ended is None else error_of(ended))


def _seal(bundle: Path) -> str | None:
    """The digest that seals a bundle; None where there is none, or none that can be read."""
    with suppress(GamekeeperError):
        return str(load_manifest(bundle)["seal"]["manifest"])
    return None


def _read(data: bytes) -> dict[str, Any]:
    """A note; an empty one where it is none of ours."""
    with suppress(ValueError, RecursionError):
        note = json.loads(data)
        if isinstance(note, dict) and type(note.get("parts")) is int and _is_error(note):
            return note
    return {}


def _is_error(note: Mapping[str, Any]) -> bool:
    ended = note.get("error")
    names = ("kind", "what", "where", "expected", "seen", "mend")
    return ended is None or (
        isinstance(ended, dict) and all(isinstance(ended.get(name), str) for name in names)
    )
