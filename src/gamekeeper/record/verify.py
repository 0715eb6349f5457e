"""Whether a bundle is what it says: no byte changed, its rows digest to its fingerprint."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from gamekeeper.core.arrow import blocks_of, cells_of
from gamekeeper.core.digest import EpisodeDigest, episode_header
from gamekeeper.core.evidence import Evidence, fingerprints
from gamekeeper.core.leaf_columns import value_columns
from gamekeeper.core.press import add_infos, state_digests
from gamekeeper.core.trace import digests_of
from gamekeeper.errors import BundleError, GamekeeperError
from gamekeeper.record.bundle import load
from gamekeeper.record.files.folder import read_bounded, reading
from gamekeeper.record.files.manifest import FORMAT_VERSION, MANIFEST, MANIFEST_BYTES, load_manifest
from gamekeeper.record.files.seal import Damage, check_seal, verify_notes


@dataclass(frozen=True, slots=True)
class Verification:
    """What looking at a bundle came to.

    Attributes:
        run: the folder.
        self_consistent: rows, states and infos digest to the fingerprints that the bundle names; at
            level "digest", the stored digests of rows do.
        matches: the fingerprint is the one given from elsewhere; None where none was given.
        damage: files that aren't as they were sealed, and places where the rows don't add up.
        fingerprint: of the rows as they are now; None where they can't be read.
    """

    run: str
    self_consistent: bool
    matches: bool | None
    damage: tuple[Damage, ...]
    fingerprint: str | None

    @property
    def ok(self) -> bool:
        """Nothing is damaged, nothing contradicts, and the given fingerprint matches."""
        return self.self_consistent and self.matches is not False and not self.damage

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper verify --json` prints."""
        return {
            "run": self.run,
            "ok": self.ok,
            "self_consistent": self.self_consistent,
            "matches": self.matches,
            "damage": [asdict(each) for each in self.damage],
            "fingerprint": self.fingerprint,
        }

    def __str__(self) -> str:
        lines = [f"{each.file}: {each.what} {each.detail}".rstrip() for each in self.damage]
        lines.append("self-consistent" if self.self_consistent else "not self-consistent")
        if self.matches is not None:
            lines.append(
                "matches the fingerprint given"
                if self.matches
                else "another fingerprint than the one given"
            )
        lines.append(f"fingerprint {self.fingerprint}")
        return "\n".join(lines)


def verify(path: str | PathLike[str], *, fingerprint: str | None = None) -> Verification:
    """Looks at every byte of a bundle and digests its rows anew. Runs nothing of what it reads.

    A seal shows damage; who can write the files can write a seal too. That a run is the one that
    somebody else means, only a fingerprint from elsewhere shows.

    Args:
        fingerprint: what the run's should be; at least 8 of its digits.
    Raises:
        BundleError: there is no bundle.
    """
    unknown = None if fingerprint is None else False
    try:
        damage = [*check_seal(path), *verify_notes(path)]
    except BundleError as error:
        if not (Path(path) / MANIFEST).exists():
            load_manifest(Path(path))  # says what is there instead
        if not _is_damaged(Path(path)):
            raise
        found = Damage(MANIFEST, "changed", error.seen or error.what)
        return Verification(str(path), False, unknown, (found,), None)
    try:
        evidence = load(path, check=False)  # every byte was compared with the seal just now
        with reading(Path(path)):
            again = digest_again(evidence)
    except GamekeeperError as error:
        if not damage:
            damage = [Damage("", "unreadable", str(error))]
        return Verification(str(path), False, unknown, tuple(damage), None)
    named = {name: evidence.manifest.get(name) for name in again.run}
    damage += [
        Damage("steps.parquet", "changed", f"episode {n} doesn't digest to its fingerprint")
        for n in again.wrong
    ]
    matches = None if fingerprint is None else _same(again.run["fingerprint"], fingerprint)
    is_consistent = named == again.run and not again.wrong
    return Verification(str(path), is_consistent, matches, tuple(damage), again.run["fingerprint"])


def _is_damaged(folder: Path) -> bool:
    """Whether there is a manifest of a format that we know, which isn't as it was sealed."""
    path = folder / MANIFEST
    if not path.is_file():
        return False
    try:
        manifest = json.loads(read_bounded(path, MANIFEST_BYTES))
    except (ValueError, RecursionError):
        return True
    except BundleError:  # nobody may look: that is no damage
        return False
    if not isinstance(manifest, dict):
        return True
    version = manifest.get("format_version")
    is_newer = type(version) is int and version > FORMAT_VERSION
    return not is_newer and manifest.get("status") != "open"


@dataclass(frozen=True, slots=True)
class Found:
    """Fingerprints computed from rows: of the run, of each episode; and which aren't as named."""

    run: dict[str, str]
    episodes: dict[int, tuple[str, str]]
    wrong: tuple[int, ...]


def digest_again(evidence: Evidence, *, volatile: Collection[str] | None = None) -> Found:
    """The fingerprints of `evidence`, computed from its rows."""
    leave_out = evidence.contract.volatile_infos() if volatile is None else volatile
    found: dict[int, tuple[str, str]] = {}
    wrong = []
    headers = evidence.episodes.to_pylist()
    for header in headers:
        number = header["episode"]
        digest = EpisodeDigest(episode_header(seed=header["seed"], options=header["options"]))
        for steps in evidence.tables.parts("steps", number) or ():
            digest.add_rows(digests_of(steps))
            _add_infos(digest, steps, number, leave_out)
        for states in evidence.tables.parts("states", number) or ():
            digest.add_states(_state_digests(states))
        found[number] = digest.fingerprint, digest.info_fingerprint
        if header["fingerprint"] is not None and found[number] != (
            header["fingerprint"],
            header["info_fingerprint"],
        ):
            wrong.append(number)
    columns = [[found[header["episode"]][place] for header in headers] for place in (0, 1)]
    table = pa.table({"fingerprint": columns[0], "info_fingerprint": columns[1]})
    return Found(fingerprints(evidence.manifest, table), found, tuple(wrong))


def _state_digests(states: pa.Table) -> Any:
    states = states.combine_chunks()
    cells = [
        (column, cells_of(column, states[column.name]))
        for column in value_columns(states.schema, "state")
    ]
    turn = np.ascontiguousarray(states["turn"].to_numpy())
    return state_digests(turn, cells, states["odd"].to_pylist())


def _add_infos(
    digest: EpisodeDigest, steps: pa.Table, number: int, volatile: Collection[str]
) -> None:
    if steps["info"].null_count == steps.num_rows:
        return
    for block in blocks_of(steps):
        add_infos({number: digest}, block, volatile)


def _same(found: str, given: str) -> bool:
    given = given.strip().lower()
    return len(given) >= 8 and found.startswith(given)
