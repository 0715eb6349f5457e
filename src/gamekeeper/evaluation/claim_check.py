"""Checks a claim: its files, what differs here, and each figure by playing the runs again.

Reading a claim executes nothing of it. Its source, or whatever its runs name, runs only by the
rules of replay: an installed environment, the user's own run, one that the user names, or
everything by the user's word.
"""

import json
import platform
import sys
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import IO, Any, Final

from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.errors import GamekeeperError, RunError, TrustError
from gamekeeper.evaluation.claim_figures import figures_in, is_same, worked_out
from gamekeeper.evaluation.claim_pack import (
    BLOCK_BYTES,
    CLAIM,
    EVALUATIONS,
    FORMAT,
    RUNS,
    SOURCE,
    digest_of,
    figures_of,
    hash_of_claim,
    installed_packages,
    signer_of,
    source_module,
)
from gamekeeper.evaluation.continuation import document_in
from gamekeeper.import_guard import guarded, unguarded
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.runs.comparison import SILENCE_S, Replay, replay
from gamekeeper.runs.load_run import load
from gamekeeper.runs.run_check import verify

MOST_BYTES: Final = 1 << 33
"""Bytes of all files of a claim together."""
LARGEST_DOCUMENT: Final = 1 << 28
"""Bytes of a claim's document."""
BROKEN: Final = (OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""Errors of an entry that can't be read: cut off, altered, encrypted, packed in another way."""
ABSENT: Final = "not installed"


@dataclass(frozen=True, slots=True)
class ClaimDifference:
    """One thing that isn't here as it was claimed: `claimed` and `here`, as text."""

    name: str
    claimed: str
    here: str


@dataclass(frozen=True, slots=True)
class ClaimFigure:
    """One figure of a run: as claimed, as the evidence has it, and whether the replay agrees.

    `ticked` is None where nothing was played again.
    """

    run: str
    name: str
    claimed: Any
    recorded: Any
    ticked: bool | None


@dataclass(frozen=True, slots=True)
class CheckedClaim:
    """Outcome of checking a claim.

    Attributes:
        digest: of what it claims.
        damage: files that aren't those that were packed.
        differs: packages and sources that are others here.
        figures: every figure of runs and evaluations, ticked or not.
        replays: by run, the replay; without one, the reason.
        reasons: by run, why it wasn't played again.
        signer: name of the allowed signer; None where nothing was asked.
    """

    claim: str
    digest: str
    damage: tuple[str, ...]
    differs: tuple[ClaimDifference, ...]
    figures: tuple[ClaimFigure, ...]
    replays: Mapping[str, Replay]
    reasons: Mapping[str, str]
    signer: str | None = None

    @property
    def ok(self) -> bool | None:
        """True: every figure is ticked. False: one is wrong. None: one couldn't be played again."""
        if self.damage or any(each.ticked is False for each in self.figures):
            return False
        return None if any(each.ticked is None for each in self.figures) else True

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper reproduce --json` prints."""
        return {**fields_json(self), "ok": self.ok}


def reproduce(
    claim: str | PathLike[str],
    folder: str | PathLike[str],
    *,
    env: str | None = None,
    allow_import: bool = False,
    signers: str | PathLike[str] | None = None,
    timeout_s: float | None = SILENCE_S,
) -> CheckedClaim:
    """Unpacks a claim, says what differs here, plays its runs again and ticks each figure.

    Args:
        folder: a new or empty folder, into which it is unpacked.
        env: environment to play in place of those that the runs name.
        allow_import: run the claim's own source, and whatever its runs name.
        signers: file of allowed signers; CLAIM.sig has to be by one of them, else nothing is read.
        timeout_s: longest time without a turn.
    Raises:
        RunError: the file is no claim, or isn't signed by an allowed signer.
        DependencyError: there are signers, and no ssh-keygen.
    """
    signer = None if signers is None else signer_of(Path(claim), Path(signers))
    document, text = _read(Path(claim))
    place = Path(folder)
    damage = _unpack(Path(claim), place, document["files"])
    replays: dict[str, Replay] = {}
    reasons: dict[str, str] = {}
    figures: list[ClaimFigure] = []
    for run in document["runs"]:
        name = str(run["name"])
        path = place / RUNS / name
        chosen = _chosen(place, run, env=env, allow_import=allow_import)
        try:
            damage += _damage_of(path, run)
            with _source_first(place / SOURCE if allow_import and env is None else None):
                played = replay(
                    path, env=chosen, allow_import=allow_import, timeout_s=timeout_s, explain=False
                )
            replays[name] = played
            if played.reason is not None:
                reasons[name] = played.reason
        except TrustError as error:
            reasons[name] = f"{error.what}: {error.actual}; {error.fix}"
        except GamekeeperError as error:
            reasons[name] = str(error)
        figures += _figures(path, run, replays.get(name))
    for evaluation in document.get("evaluations", ()):
        figures += _evaluated(place, evaluation, replays)
    differs = (*_other_packages(document), *_other_source(place, document, replays))
    return CheckedClaim(
        str(claim),
        digest_of(text),
        tuple(damage),
        differs,
        tuple(figures),
        replays,
        reasons,
        signer,
    )


def _read(claim: Path) -> tuple[dict[str, Any], bytes]:
    """The document of a claim, and its text.

    Raises:
        RunError: the file is no claim.
    """
    try:
        with zipfile.ZipFile(claim) as archive, archive.open(CLAIM) as entry:
            text = entry.read(LARGEST_DOCUMENT)
        document = json.loads(text)
        is_whole = document["format"] == FORMAT and isinstance(document["packages"], dict)
        runs, evaluations = document["runs"], document.get("evaluations", [])
        names = [str(each["name"]) for each in (*runs, *evaluations)]
        names += [run for each in evaluations for _, _, run in each["runs"]]
        is_whole &= all(map(_is_plain, [*names, *document["files"]]))
        is_whole &= all(isinstance(each["figures"], dict) for each in runs)
        environments = [each.get("environment") or {} for each in runs]
        is_whole &= all(isinstance(each.get("versions") or {}, dict) for each in environments)
    except (ValueError, KeyError, TypeError, AttributeError, *BROKEN) as error:
        raise _no_claim(claim, f"{type(error).__name__}: {error}") from error
    if not is_whole:
        raise _no_claim(claim, "another format, or names that lead out of it")
    return document, text


def _no_claim(claim: Path, actual: str) -> RunError:
    return RunError(
        "the file is no claim",
        where=str(claim),
        expected="what gamekeeper pack wrote",
        actual=actual[:300],
        fix="ask for the file again, or pack the runs again",
    )


def _is_plain(name: str) -> bool:
    """A name that stays in the folder it is unpacked into, on every system."""
    parts = PurePosixPath(name).parts
    leads_out = name.startswith("/") or ".." in parts or PureWindowsPath(name).drive
    return bool(parts) and not leads_out and "\\" not in name


def _unpack(claim: Path, folder: Path, files: Mapping[str, str]) -> list[str]:
    """Writes a claim's files; names those that aren't as packed.

    Raises:
        RunError: the folder holds something, or the claim is too large.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise RunError(
            "a claim is unpacked into an empty folder",
            where=str(folder),
            actual="a folder that holds something",
            fix="name a new one",
        )
    damage: list[str] = []
    left = MOST_BYTES
    with zipfile.ZipFile(claim) as archive:
        for name, digest in files.items():
            try:
                (target := folder / name).parent.mkdir(parents=True, exist_ok=True)
                with archive.open(name) as entry, target.open("xb") as file:
                    size, found = _copied(entry, file, left)
            except (KeyError, *BROKEN) as error:
                damage.append(f"{name}: {'missing' if isinstance(error, KeyError) else error}")
                continue
            left -= size
            if left < 0:
                raise _no_claim(claim, f"more than {MOST_BYTES:,} bytes")
            if found != digest:
                damage.append(f"{name}: not the file that was packed")
    return damage


def _copied(entry: IO[bytes], file: IO[bytes], most: int) -> tuple[int, str]:
    """Copies an entry, and not much more than `most` bytes; returns its size and digest."""
    size, found = 0, hash_of_claim()
    while size <= most and (block := entry.read(BLOCK_BYTES)):
        size += len(block)
        found.update(block)
        file.write(block)
    return size, found.hexdigest()


def _damage_of(path: Path, run: Mapping[str, Any]) -> list[str]:
    """A run's own damage, and a root digest other than the claimed one."""
    with guarded(path):
        found = verify(path, root=str(run.get("root")))
    if found.ok:
        return []
    first = str(found).splitlines()[0]
    return [f"{RUNS}/{run['name']}: {first}"]


def _chosen(
    folder: Path, run: Mapping[str, Any], *, env: str | None, allow_import: bool
) -> str | None:
    """The environment to play: the user's, the claim's own source by the user's word, or the run's.

    A file's place on another machine says nothing here.
    """
    identity = run.get("environment")
    if env is not None or not allow_import or not isinstance(identity, Mapping):
        return env
    packed = folder / SOURCE / source_module(identity)
    if identity.get("kind") != "file" or not packed.is_file():
        return None
    return f"{packed}:{str(identity.get('entry_point')).rpartition(':')[2]}"


@contextmanager
def _source_first(source: Path | None) -> Iterator[None]:
    """Has workers look for modules in a claim's source first, if it is there."""
    if source is None or not source.is_dir():
        yield
        return
    with unguarded():  # the user has consented
        sys.path.insert(0, str(source.resolve()))
        yield


def _figures(path: Path, run: Mapping[str, Any], played: Replay | None) -> list[ClaimFigure]:
    """Each claimed figure beside the evidence's, ticked where the replay is verified."""
    try:
        with guarded(path):
            recorded: Mapping[str, Any] = figures_of(load(path))
    except GamekeeperError:
        recorded = {}
    is_played = played is not None and played.reason is None
    verified = played.verified if is_played and played is not None else None
    found = []
    for name, claimed in run["figures"].items():
        seen = recorded.get(name)
        ticked = verified if seen == claimed else False
        found.append(ClaimFigure(str(run["name"]), str(name), claimed, seen, ticked))
    return found


def _evaluated(
    place: Path, evaluation: Mapping[str, Any], replays: Mapping[str, Replay]
) -> list[ClaimFigure]:
    """Each figure of an evaluation beside what its recorded runs come to.

    Ticked where they agree and all its runs are verified.
    """
    name = str(evaluation["name"])
    folders = {(env, pairing): str(run) for env, pairing, run in evaluation["runs"]}
    played = [replays.get(run) for run in folders.values()]
    is_played = all(each is not None and each.reason is None for each in played)
    verified = all(each is not None and each.verified for each in played) if is_played else None
    try:
        with guarded(place):
            document = document_in(Storage.at(place / EVALUATIONS / name))
            runs = {key: load(place / RUNS / run) for key, run in folders.items()}
            claimed, seen = figures_in(document), worked_out(document, runs)
    except (GamekeeperError, LookupError, TypeError, ValueError, AttributeError) as error:
        return [ClaimFigure(name, "all", "figures", f"unreadable: {error!r}"[:300], False)]
    figures = []
    for key in dict.fromkeys([*claimed, *seen]):
        one, other = claimed.get(key), seen.get(key)
        # intervals that allow for stopping aren't worked out again
        is_open = bool(document.get("stopping")) and key.endswith((".low", ".high"))
        ticked = verified if is_same(one, other) else None if is_open else False
        figures.append(ClaimFigure(name, key, one, other, ticked))
    return figures


def _other_packages(document: Mapping[str, Any]) -> Iterator[ClaimDifference]:
    """Packages that the runs name and that have another version here; then all others."""
    here = {**installed_packages(), "python": platform.python_version()}
    named: dict[str, str] = {}
    for run in document["runs"]:
        named |= (run.get("environment") or {}).get("versions") or {}
    claimed = {**named, **{k: v for k, v in document["packages"].items() if k not in named}}
    for name, version in claimed.items():
        if here.get(name, ABSENT) != version:
            yield ClaimDifference(name, str(version), here.get(name, ABSENT))


def _other_source(
    folder: Path, document: Mapping[str, Any], replays: Mapping[str, Replay]
) -> Iterator[ClaimDifference]:
    """Files of the claim's source that are others in the current folder, and sources as played."""
    for name, digest in document["files"].items():
        if name.startswith(f"{SOURCE}/"):
            beside = Path(name.partition("/")[2])
            if beside.is_file() and digest_of(beside) != digest:
                yield ClaimDifference(
                    str(beside), "the packed file", "another file of this name, in this folder"
                )
    for run, played in replays.items():
        if "source" in played.versions:
            one, two = played.versions["source"]
            yield ClaimDifference(f"source of {run}", str(one), str(two))
