"""What is to be recorded, and the parts in which it is played, whoever plays them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import BundleError, EvidenceError
from gamekeeper.run.executors.storage import Storage

PARTS: Final = 64
"""Parts of a run, as long as none has more than `MOST_EPISODES`."""
MOST_EPISODES: Final = 256
"""Of a part: what a death costs, and how far workers can end apart."""
FOLDER: Final = "parts"
PLAN: Final = "plan.json"
MERGED: Final = "merged.json"
FORMAT: Final = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is to be recorded; the fields are those of `gamekeeper.record.tasks:record_task`.

    Attributes:
        spec: names the environment.
        env_kwargs: its arguments.
        policies: names, by agent, role or under `*`; empty: random.
        contract: path of a contract's file; None: the environment's own.
    """

    spec: str
    env_kwargs: Mapping[str, Any]
    policies: Mapping[str, str]
    episodes: int
    seed: int
    options: Mapping[str, Any] | None
    level: str
    frames: bool
    most_turns: int | None
    contract: str | None

    def to_json(self) -> dict[str, Any]:
        """Plain data; arguments keep their very types.

        Raises:
            EvidenceError: an argument is an object that no text can build again.
        """
        from gamekeeper.core.canon import is_exact, to_json

        given = to_json([dict(self.env_kwargs), self.options])
        if not is_exact(given):
            raise EvidenceError(
                "an argument is an object that no text can build again",
                where="env_kwargs, options",
                seen=given[:200],
                mend="use plain arguments, or record in one process, without workers",
            )
        fields = asdict(self)
        return {**fields, "env_kwargs": None, "options": None, "given": given}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Plan:
        """What `to_json` gave."""
        from gamekeeper.core.canon import from_json

        given: Any = from_json(data["given"])
        fields = {key: value for key, value in data.items() if key != "given"}
        return cls(**{**fields, "env_kwargs": given[0], "options": given[1]})

    def ranges(self) -> Iterator[range]:
        """The episodes of each part, in their order; they depend on the plan alone."""
        size = min(max(-(-self.episodes // PARTS), 1), MOST_EPISODES)
        for first in range(0, self.episodes, size):
            yield range(first, min(first + size, self.episodes))


def parts_folder(out: Path) -> Path:
    """Where the parts of a run lie that nobody named a place for: `OUT-parts`."""
    whole = out.absolute()  # `.` has a name there
    return whole.with_name(f"{whole.name}-parts")


def key_of(episodes: range) -> str:
    """The key of the part that holds these episodes; keys sort as episodes do."""
    return f"episodes-{episodes.start:010d}-{episodes.stop:010d}"


def claim(storage: Storage, plan: Plan) -> bool:
    """The storage is this plan's; tells whether it was already, so that parts may lie there.

    Raises:
        BundleError: parts of another plan lie there, or the storage refuses.
    """
    mine = _described(plan)
    if not storage.exists(PLAN):
        if storage.names(FOLDER):
            raise BundleError(
                "parts of nobody knows what lie here",
                where=str(storage),
                expected=f"{PLAN} beside them",
                mend="name another place, or take them away",
            )
        storage.put(PLAN, mine)
        return False
    there = storage.get(PLAN)
    if there == mine:
        return True
    raise BundleError(
        "parts of another recording lie here",
        where=str(storage),
        expected="the same environment, arguments, policies, contract, seed and episodes",
        seen=_differences(there, mine),
        mend="repeat the command that was begun, name another place, or take these parts away",
    )


def is_free(storage: Storage, plan: Plan) -> bool:
    """Whether nobody else's parts lie there.

    Raises:
        BundleError: the storage refuses.
    """
    return not storage.exists(PLAN) or storage.get(PLAN) == _described(plan)


def release(storage: Storage) -> None:
    """The parts and their plan are gone; so is the folder, where nothing else lies in it.

    Raises:
        BundleError: the storage refuses.
    """
    for name in (FOLDER, PLAN, MERGED):  # the last one tells that what is left may go
        storage.delete(name)
    if storage.folder is not None and storage.folder.is_dir():
        for name in (PLAN, MERGED):
            for draft in storage.folder.glob(f".*.{name}"):
                draft.unlink(missing_ok=True)
        if not any(storage.folder.iterdir()):
            storage.folder.rmdir()


def digest_of(plan: Plan) -> str:
    """Tells plans apart as `claim` does."""
    return blake2b(_described(plan), digest_size=16).hexdigest()


def _described(plan: Plan) -> bytes:
    """The plan as it is compared: a contract counts by what its file says."""
    contract = None if plan.contract is None else Path(plan.contract)
    text = contract.read_bytes() if contract is not None and contract.is_file() else b""
    fields = {
        **plan.to_json(), "format": FORMAT,
        "contract_digest": blake2b(text, digest_size=16).hexdigest() if text else None,
    }  # fmt: skip
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
