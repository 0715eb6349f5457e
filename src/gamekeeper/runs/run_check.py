"""Verifies a run byte by byte, and recovers one that its recorder left open."""

import json
import re
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.actions_level import KeptDigest, add_kept
from gamekeeper.episodes.arrow import blocks_of
from gamekeeper.episodes.digest import EpisodeDigest, episode_header, state_digests
from gamekeeper.episodes.encoder import EPISODES, KEPT, LEVELS, add_infos, by_episode
from gamekeeper.episodes.episode import digests_of, states_of_table
from gamekeeper.episodes.evidence import Evidence, fingerprints
from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.episodes.row_tables import html_text
from gamekeeper.errors import EvidenceError, GamekeeperError, RunError
from gamekeeper.runs.files.checksums import (
    Damage,
    compare_checksums,
    root_digest,
    strays,
    verify_notes,
)
from gamekeeper.runs.files.folder import MANIFEST, read_bounded, reading
from gamekeeper.runs.files.manifest import FORMAT_VERSION, MANIFEST_BYTES, load_manifest
from gamekeeper.runs.files.notes import chain
from gamekeeper.runs.files.open_streams import finalize_recovered
from gamekeeper.runs.load_run import load
from gamekeeper.runs.ring.ring_ledger import with_recovered

# -- Verifies that no byte of a run changed, and that its rows digest to its fingerprint

DIGITS: Final = re.compile(rf"(?:({'|'.join(LEVELS)}):)?([0-9a-f]{{32,64}})")
"""Level of a fingerprint and digits: so many of the first that they can't be forged, or all."""
NOTHING_GIVEN: Final = (
    "not checked: that this is the run that you mean; whoever made it can make all its digests "
    "fit. --root X (in Python, root=X) compares it with a root digest that you got another way"
)
FINGERPRINT_GIVEN: Final = (
    "not checked: infos, contract, policies, how episodes ended, timings and versions, which no "
    "fingerprint covers. --root X (in Python, root=X) compares them with a root digest that you "
    "got another way"
)


@dataclass(frozen=True, slots=True)
class Verification:
    """Outcome of verifying a run.

    Attributes:
        run: the folder.
        self_consistent: rows, states and infos digest to the fingerprints that the run names; at
            level "digest", the stored digests of rows do.
        matches: root digest and fingerprint are those given from elsewhere; None without any.
        damage: files that aren't as they were finalized, and places where the rows don't add up.
        fingerprint: of the rows as they are now; None where they can't be read.
        root: root digest of the files as they are now; None where one of them is damaged.
        strays: entries of the folder that are no part of the run; no digest covers them.
        not_checked: the part that wasn't compared, in a line; None with a root digest given.
        annotations: labels and diagnoses that were added later, which no digest of the run covers.
    """

    run: str
    self_consistent: bool
    matches: bool | None
    damage: tuple[Damage, ...]
    fingerprint: str | None
    root: str | None = None
    strays: tuple[str, ...] = ()
    not_checked: str | None = None
    annotations: int = 0

    @property
    def ok(self) -> bool:
        """True if the run is undamaged and consistent, and matches the digests that were given."""
        return self.self_consistent and self.matches is not False and not self.damage

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper verify --json` prints."""
        return {**fields_json(self), "ok": self.ok}

    def __str__(self) -> str:
        damage = [f"{each.file}: {each.what}; {each.detail}".rstrip("; ") for each in self.damage]
        whole = "whole: every file matches its checksum"
        lines = [f"damaged: {len(damage)} found", *damage] if damage else [whole]
        if not self.self_consistent:
            lines.append("not self-consistent: its digests contradict its files")
        if self.matches is not None:
            lines.append(
                "matches the digest that was given"
                if self.matches
                else "not the run whose digest was given"
            )
        lines += [f"fingerprint {self.fingerprint}", f"root digest {self.root}"]
        if self.annotations:
            lines.append(
                f"{self.annotations} annotations, added later by label, diagnose or attribute: not "
                "in the root digest"
            )
        lines += [f"stray (no part of the run): {name}" for name in self.strays]
        lines += [self.not_checked] if self.not_checked else []
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return html_text(str(self))


def verify(
    path: str | PathLike[str], *, root: str | None = None, fingerprint: str | None = None
) -> Verification:
    """Compares every byte of a run and digests its rows anew. Runs no code that it reads.

    Checksums show damage; the author of a run can write checksums too. Only a root digest from
    elsewhere shows that a run is the one that another person means.

    Args:
        root: expected root digest; at least 32 of its digits.
        fingerprint: expected fingerprint; the same. It covers less than the root digest.
    Raises:
        RunError: there is no run.
        EvidenceError: a text that is given is no digest, or a fingerprint of another level.
    """
    root, fingerprint = _digits("root", root), _digits("fingerprint", fingerprint)
    found = _against_itself(Path(path))
    level, _, digits_again = (found.fingerprint or "").partition(":")
    if fingerprint is not None and ":" in fingerprint:
        asked, _, fingerprint = fingerprint.partition(":")
        _check_same_level(path, asked, level)
    kinds = {"root": found.root or "", "fingerprint": digits_again}
    # A fingerprint that is given as the root digest, or the reverse, is a mistake and no other run.
    for option, digits, other in (
        ("root", root, "fingerprint"),
        ("fingerprint", fingerprint, "root"),
    ):
        if digits and not kinds[option].startswith(digits) and kinds[other].startswith(digits):
            raise _mistaken(option, digits)
    given = [(root, found.root), (fingerprint, digits_again)]
    matched = [(seen or "").startswith(digits) for digits, seen in given if digits is not None]
    return replace(
        found,
        run=str(path),
        matches=all(matched) if matched else None,
        not_checked=None if root else FINGERPRINT_GIVEN if fingerprint else NOTHING_GIVEN,
    )


def _against_itself(folder: Path) -> Verification:
    """Verifies a run without digests from elsewhere."""
    try:
        damage = [*compare_checksums(folder), *verify_notes(folder)]
    except RunError as error:
        if not (folder / MANIFEST).exists():
            load_manifest(folder)  # says what is there instead
        if not _is_damaged(folder):
            raise
        changed = Damage(MANIFEST, "changed", error.actual or error.what)
        return Verification("", False, None, (changed,), None)
    root = None if damage else root_digest(folder, check=False)
    notes = sum(1 for _ in chain(folder))
    found = Verification(
        "", False, None, tuple(damage), None, root, strays(folder), annotations=notes
    )
    try:
        evidence = load(folder, check=False)  # every byte was compared with the checksums just now
        with reading(folder):
            again = digest_again(evidence)
    except GamekeeperError as error:
        damage = damage or [Damage("", "unreadable", str(error))]
        return replace(found, damage=tuple(damage))
    except Exception:
        if not damage:
            raise
        return found  # a changed byte may have named a column otherwise: the file is known already
    damage += [
        Damage("agent_steps.parquet", "changed", f"episode {n} doesn't digest to its fingerprint")
        for n in again.wrong
    ]
    against = contradiction(evidence, again)
    if against and not again.wrong:
        damage.append(Damage(MANIFEST, "contradicts its files", against))
    return replace(
        found,
        self_consistent=not against,
        damage=tuple(damage),
        fingerprint=again.run["fingerprint"],
    )


def _is_damaged(folder: Path) -> bool:
    """True if there is a manifest of a known format, which isn't as it was finalized."""
    path = folder / MANIFEST
    if not path.is_file():
        return False
    try:
        manifest = json.loads(read_bounded(path, MANIFEST_BYTES))
    except (ValueError, RecursionError):
        return True
    except RunError:  # it may not be read: that is no damage
        return False
    if not isinstance(manifest, dict):
        return True
    version = manifest.get("format_version")
    is_known = type(version) is not int or version <= FORMAT_VERSION
    return is_known and manifest.get("status") != "open"


@dataclass(frozen=True, slots=True)
class ComputedFingerprints:
    """Fingerprints computed from rows: of the run, of each episode; and episodes that differ."""

    run: dict[str, str]
    episodes: dict[int, tuple[str, str]]
    wrong: tuple[int, ...]


def digest_again(evidence: Evidence) -> ComputedFingerprints:
    """The fingerprints of `evidence`, computed from its rows."""
    volatile = evidence.contract.volatile_infos()
    found: dict[int, tuple[str, str]] = {}
    wrong = []
    headers = evidence.episode_table.to_pylist()
    for header in headers:
        number = header["episode"]
        print_of = KeptDigest if evidence.manifest.get("level") == KEPT else EpisodeDigest
        digest: Any = print_of(episode_header(seed=header["seed"], options=header["options"]))
        for steps in evidence.tables.parts("agent_steps", number) or ():
            _check_own(steps, number)
            if "observed" in steps.schema.names:
                for block in blocks_of(steps):
                    add_kept({number: digest}, block, by_episode)
                continue
            digest.add_rows(digests_of(steps))
            if steps["info"].null_count < steps.num_rows:
                for block in blocks_of(steps):
                    add_infos({number: digest}, block, volatile)
        for part in evidence.tables.parts("states", number) or ():
            digest.add_states(state_digests(states_of_table(part)))
        found[number] = digest.fingerprint, digest.info_fingerprint
        if header["fingerprint"] is not None and found[number] != (
            header["fingerprint"],
            header["info_fingerprint"],
        ):
            wrong.append(number)
    names = ("fingerprint", "info_fingerprint")
    rows = [dict(zip(names, found[header["episode"]], strict=True)) for header in headers]
    table = pa.Table.from_pylist(rows, pa.schema([(name, pa.string()) for name in names]))
    return ComputedFingerprints(fingerprints(evidence.manifest, table), found, tuple(wrong))


def with_prints(evidence: Evidence) -> pa.Table:
    """The table of episodes with their fingerprints, computed where the run has none stored."""
    table = evidence.episode_table
    if evidence.manifest.get("level") != KEPT or table["fingerprint"].null_count < len(table):
        return table
    found = digest_again(evidence).episodes
    prints = zip(*(found[number] for number in table["episode"].to_pylist()), strict=True)
    for name, column in zip(("fingerprint", "info_fingerprint"), prints, strict=False):
        place = table.schema.get_field_index(name)
        table = table.set_column(place, name, pa.array(column, pa.string()))
    return table


def contradiction(evidence: Evidence, again: ComputedFingerprints | None = None) -> str:
    """Claims of a run that its rows don't bear out, in words; empty where all fits.

    Fingerprints, the steps of each episode and the agents are what rows and spaces tell too.
    """
    again = again or digest_again(evidence)
    manifest = evidence.manifest
    named = {name: manifest.get(name) for name in again.run}
    if again.wrong:
        return f"episode {again.wrong[0]} doesn't digest to its fingerprint"
    if named != again.run and manifest.get("status") != "open":
        return "its rows and spaces don't digest to its fingerprint"
    if set(manifest.get("agents") or manifest["spaces"]) != set(manifest["spaces"]):
        return "its agents aren't those that have spaces"
    for header in evidence.headers:
        least, last = evidence.reach(header["episode"])  # steps that the rows allow
        most = max(least, last)
        if header["turns"] is not None and not least <= header["turns"] <= most:
            return f"episode {header['episode']} has {most} steps, not {header['turns']}"
    return ""


def _check_own(steps: pa.Table, number: int) -> None:
    """Raises where the rows of an episode hold those of another one.

    Raises:
        RunError: they do.
    """
    if not pc.all(pc.equal(steps["episode"], number)).as_py() and steps.num_rows:
        raise RunError(
            f"rows of another episode stand among those of episode {number}",
            where="agent_steps.parquet",
            expected="rows in the order of episodes",
            fix="get the run anew from where it was recorded",
        )


def _digits(option: str, given: str | None) -> str | None:
    """The digits of a digest that was copied with spaces or points around it."""
    if given is None:
        return None
    digits = given.strip().rstrip(".…").lower()
    found = DIGITS.fullmatch(digits)
    if found is not None and (option == "fingerprint" or found[1] is None):
        return digits
    if found is not None:
        raise _mistaken("root", given)
    raise EvidenceError(
        f"this is no {'root digest' if option == 'root' else option}",
        where=f"--{option}",
        expected="32 to 64 digits of 0 to 9 and a to f",
        actual=repr(given[:80]),
        fix="copy it from where the run was announced; `gamekeeper show RUN` says it too",
    )


def _mistaken(option: str, given: str) -> EvidenceError:
    """The error of a digest of one kind that was given as the other."""
    is_root = option == "root"
    kind, other = ("a fingerprint", "fingerprint") if is_root else ("a root digest", "root")
    return EvidenceError(
        f"this is {kind}, not a {'root digest' if is_root else 'fingerprint'}",
        where=f"--{option}",
        actual=repr(given[:80]),
        fix=f"give it to --{other} (in Python, {other}=); `gamekeeper show RUN` prints both",
    )


def _check_same_level(path: object, asked: str, level: str) -> None:
    """Raises where a fingerprint is of another level than the run: they cover different things."""
    if level and asked != level:
        raise EvidenceError(
            "fingerprints of different levels aren't compared",
            where=str(path),
            expected=f"a fingerprint {level}:...",
            actual=f"{asked}:...",
            fix="gamekeeper expand RUN OUT makes a full run of one of level actions",
        )


# -- Finalizes a run that was killed, with the longest prefix of whole turns


def recover(
    path: str | PathLike[str],
    *,
    status: str = "recovered",
    error: str | None = None,
    is_theirs: bool = True,
) -> Evidence:
    """Finalizes a run that its recorder left open; its last episode is kept as *torn*.

    Args:
        error: the error that ended the last episode; it then counts as failed.
        is_theirs: the error is the environment's, which a replay has to come to again; one of the
            disk leaves the episode *torn*.
    Raises:
        RunError: there is no run, or it is still being recorded.
    """
    evidence = load(path, salvage=True)
    if evidence.manifest.get("status") != "open":
        return evidence
    found = digest_again(evidence)
    rows = evidence.episode_table.to_pylist()
    for row in rows:
        row["fingerprint"], row["info_fingerprint"] = found.episodes[row["episode"]]
        if row["end"] is None:
            row |= {"end": "torn", "turns": _turns(evidence, row["episode"])}
    if error is not None and rows:
        end = "failed" if is_theirs else rows[-1]["end"]
        rows[-1] |= {"end": end, "error": rows[-1]["error"] or error}
    episodes = pa.Table.from_pylist(rows, schema=EPISODES)
    manifest: dict[str, Any] = {
        **evidence.manifest,
        **fingerprints(evidence.manifest, episodes),
        "status": status,
    }
    if "keep" in manifest:
        manifest["keep"] = with_recovered(manifest["keep"], len(rows))
    if error is not None:
        manifest["error"] = error
    finalize_recovered(path, manifest, episodes=episodes)
    return load(path)


def _turns(evidence: Evidence, episode: int) -> int:
    """The whole turns of an episode: a row of timings for each, where any were written yet."""
    timings = evidence.timings
    if timings is None:
        return evidence.reach(episode)[0]
    return int(timings["episode"].to_pylist().count(episode))
