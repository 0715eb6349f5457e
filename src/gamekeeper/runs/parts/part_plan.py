"""The plan of a recording, its parts, and the note that they are merged."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import GamekeeperError, RunError
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.runs.files.manifest import load_manifest
from gamekeeper.runs.worker_errors import error_of

# -- The plan of a recording, and the parts in which it is played by any worker

FOLDER: Final = "parts"
PLAN: Final = "plan.json"
MERGED: Final = "merged.json"
FORMAT: Final = 1


def parts_folder(out: Path) -> Path:
    """Folder of the parts of a run, where none is named: `OUT-parts`."""
    whole = out.absolute()  # `.` has a name there
    return whole.with_name(f"{whole.name}-parts")


def key_of(episodes: range) -> str:
    """The key of the part that holds these episodes; keys sort as episodes do."""
    return f"episodes-{episodes.start:010d}-{episodes.stop:010d}"


def claim(storage: Storage, plan: RolloutPlan) -> bool:
    """Claims the storage for this plan; True if it was claimed before, so that parts may be there.

    Raises:
        RunError: parts of another plan lie there, or the storage refuses.
    """
    mine = _described(plan)
    if not storage.exists(PLAN):
        if storage.names(FOLDER):
            raise RunError(
                "part files without their plan lie here",
                where=str(storage),
                expected=f"{PLAN} beside them",
                fix="name another place, or take them away",
            )
        storage.put(PLAN, mine)
        return False
    there = storage.get(PLAN)
    if there == mine:
        return True
    raise RunError(
        "parts of another recording lie here",
        where=str(storage),
        expected="the same environment, arguments, policies, contract, seed and episodes",
        actual=_differences(there, mine),
        fix="repeat the command that was begun, name another place, or take these parts away",
    )


def is_free(storage: Storage, plan: RolloutPlan) -> bool:
    """True if no parts of another plan lie there.

    Raises:
        RunError: the storage refuses.
    """
    return not storage.exists(PLAN) or storage.get(PLAN) == _described(plan)


def release(storage: Storage) -> None:
    """Removes the parts and their plan, and the folder if it is empty then.

    Raises:
        RunError: the storage refuses.
    """
    for name in (FOLDER, PLAN, MERGED):  # the last one tells that what is left may go
        storage.delete(name)
    if storage.folder is not None and storage.folder.is_dir():
        for name in (PLAN, MERGED):
            for draft in storage.folder.glob(f".*.{name}"):
                draft.unlink(missing_ok=True)
        if not any(storage.folder.iterdir()):
            storage.folder.rmdir()


def digest_of(plan: RolloutPlan) -> str:
    """Digest of a plan; `claim` compares the same fields."""
    return blake2b(_described(plan), digest_size=16).hexdigest()


def _described(plan: RolloutPlan) -> bytes:
    """The plan as it is compared: a contract by the content of its file."""
    portable = plan.portable()
    contract = None if portable.contract is None else Path(str(portable.contract))
    text = contract.read_bytes() if contract is not None and contract.is_file() else b""
    fields = {
        **portable.to_json(),
        "format": FORMAT,
        "contract_digest": blake2b(text, digest_size=16).hexdigest() if text else None,
    }
    return json.dumps(fields, sort_keys=True, indent=1).encode() + b"\n"


def _differences(there: bytes, mine: bytes) -> str:
    """The fields in which two plans differ."""
    try:
        theirs, ours = json.loads(there), json.loads(mine)
        names = sorted(n for n in theirs.keys() | ours.keys() if theirs.get(n) != ours.get(n))
    except (ValueError, AttributeError):
        return "a plan that can't be read"
    shown = [f"{name}: {str(theirs.get(name))[:60]}" for name in names]
    return "; ".join(shown)[:300] or "another spelling"


# -- That parts are merged is noted beside them, just before their run takes its place
#
# Between the two and the end of the command a process may die. The note names the run by its
# checksums, so that the same command knows its own work from anything else that lies there.

NOTE_BYTES: Final = 1 << 20
"""Most that a note may hold: a digest each, and the fields of an error."""
ERROR_FIELDS: Final = ("kind", "what", "where", "expected", "actual", "fix")


@dataclass(frozen=True, slots=True)
class MergeNote:
    """A run that was merged before.

    Attributes:
        parts: number of parts in it.
        error: of the first episode that failed; None where none did.
    """

    parts: int
    error: GamekeeperError | None


def note_merged(
    storage: Storage,
    plan: RolloutPlan,
    finalized: Path,
    *,
    parts: int,
    ended: Mapping[str, str] | None,
) -> None:
    """Notes in the storage which run is about to take its place.

    Args:
        finalized: the run, where it lies yet.
        ended: fields of the error of the first episode that failed.
    Raises:
        RunError: the storage refuses.
    """
    note = {
        "plan": digest_of(plan),
        "checksums": _checksums_of(finalized),
        "parts": parts,
        "error": None if ended is None else dict(ended),
    }
    storage.put(MERGED, json.dumps(note).encode())


def found_merged(storage: Storage, plan: RolloutPlan, out: Path) -> MergeNote | None:
    """The note on the run `out`, if it is the one that this plan's parts were merged into.

    Raises:
        RunError: the storage refuses.
    """
    checksums = _checksums_of(out)
    if checksums is None or not storage.exists(MERGED):
        return None
    note = _read(storage.get(MERGED, most_bytes=NOTE_BYTES))
    if (note.get("plan"), note.get("checksums")) != (digest_of(plan), checksums):
        return None
    ended = note["error"]
    return MergeNote(note["parts"], None if ended is None else error_of(ended))


def _checksums_of(run_files: Path) -> str | None:
    """The digest that finalizes a run; None where there is none, or none that can be read."""
    with suppress(GamekeeperError):
        return str(load_manifest(run_files)["checksums"]["manifest"])
    return None


def _read(data: bytes) -> dict[str, Any]:
    """A note; an empty one where it is none of ours."""
    with suppress(ValueError, RecursionError, AttributeError):
        note = json.loads(data)
        error = dict.fromkeys(ERROR_FIELDS, "") if note.get("error") is None else note["error"]
        is_error = all(isinstance(error.get(name), str) for name in ERROR_FIELDS)
        if type(note.get("parts")) is int and is_error:
            return dict(note)
    return {}
