"""manifest.json: read with suspicion, written in one exact spelling; advice where it is missing."""

import difflib
import hashlib
import json
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.runs.files.folder import MANIFEST, is_safe_name, read_bounded, reading

# -- manifest.json: the description of a run, read with suspicion, written in one exact spelling

FORMAT_VERSION: Final = 1
MANIFEST_BYTES: Final = 64 << 20  # a manifest of 10,000 frames' digests has about 1.3 MB
DEPTH: Final = 200  # nested spaces are the deepest thing in it; the deepest seen have 6 levels
STATUSES: Final = ("open", "finalized", "recovered", "failed")
DIGEST: Final = "blake2b-256"


@dataclass(frozen=True, slots=True)
class Checksums:
    """The digest of the manifest (without its checksums) and of every finalized file's bytes.

    Args:
        manifest: hexadecimal blake2b-256 of the manifest's canonical JSON.
        files: by name, the size in bytes and the digest.
    """

    manifest: str
    files: dict[str, tuple[int, str]]

    def to_json(self) -> dict[str, Any]:
        """The checksums as they stand in the manifest."""
        files = {
            name: {"size": size, "digest": digest} for name, (size, digest) in self.files.items()
        }
        return {"algorithm": DIGEST, "manifest": self.manifest, "files": files}


def render(manifest: dict[str, Any]) -> bytes:
    """The one exact spelling of a manifest: sorted keys, ASCII, one space of indent, a line's end.

    Raises:
        EvidenceError: it holds what standard JSON can't (NaN, infinities, bytes, cycles).
    """
    try:
        text = _spelled(manifest, {})
    except (TypeError, ValueError, RecursionError) as error:
        raise EvidenceError(
            "the manifest can't be written as JSON",
            where=MANIFEST,
            actual=str(error),
            fix="encode NaN, infinities, bytes and objects as text first",
        ) from error
    return text.encode("ascii") + b"\n"


def _spelled(value: Any, known: dict[int, str]) -> str:
    """JSON as `json.dumps` indents it; an object that stands in several places is spelled once.

    json's own indenting is written in Python, and agents by the hundred share their spaces.

    Args:
        known: spellings by `id`, of objects that live on meanwhile.
    """
    text = known.get(id(value))
    if text is None:
        if type(value) is dict and value and set(map(type, value)) == {str}:
            entries = sorted(value.items())
            parts = [f"\n{json.dumps(key)}: {_spelled(each, known)}" for key, each in entries]
            text = "{" + ",".join(parts).replace("\n", "\n ") + "\n}"  # texts have no line feeds
        else:
            text = json.dumps(value, sort_keys=True, indent=1, allow_nan=False)
        known[id(value)] = text
    return text


def manifest_digest(manifest: dict[str, Any]) -> str:
    """Digest of the canonical JSON of the manifest without its checksums."""
    rest = {key: value for key, value in manifest.items() if key != "checksums"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.blake2b(text.encode("ascii"), digest_size=32).hexdigest()


def load_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run, with its version, status and checksums of the right shape.

    Raises:
        RunError: there is no run, its manifest is damaged, or a newer one than we read.
    """
    path = folder / MANIFEST
    if not path.exists() and not path.is_symlink():
        raise no_run(folder)
    return parse_manifest(read_bounded(path, MANIFEST_BYTES), path)


def parse_manifest(data: bytes, path: Path) -> dict[str, Any]:
    """The manifest that these bytes spell.

    Raises:
        RunError: they spell none.
    """
    with reading(path):
        manifest = json.loads(
            data.decode("utf-8"), parse_constant=_refuse_constant, parse_float=_finite
        )
    if not isinstance(manifest, dict):
        raise _damaged(path, "a JSON object", type(manifest).__name__)
    _check_version(manifest, path)
    _check_depth(manifest, path)
    if manifest.get("status") not in STATUSES:
        raise _damaged(
            path, f"status: one of {', '.join(STATUSES)}", _short(manifest.get("status"))
        )
    checksums_of(manifest, path)
    return manifest


def checksums_of(manifest: dict[str, Any], path: Path) -> Checksums | None:
    """The manifest's checksums, None while the run is open.

    Raises:
        RunError: the checksums are missing where the status asks for one, or of the wrong shape.
    """
    if manifest["status"] == "open":
        return None
    checksums = manifest.get("checksums")
    if not isinstance(checksums, dict):
        raise _damaged(
            path, f"checksums, since the status is {manifest['status']}", _short(checksums)
        )
    if checksums.get("algorithm") != DIGEST:
        raise _damaged(path, f"checksums.algorithm: {DIGEST}", _short(checksums.get("algorithm")))
    files = checksums.get("files")
    if not _is_digest(checksums.get("manifest")) or not isinstance(files, dict):
        raise _damaged(
            path, "checksums.manifest: a digest, checksums.files: an object", _short(checksums)
        )
    return Checksums(
        checksums["manifest"], {name: _finalized(name, files[name], path) for name in files}
    )


def _finalized(name: str, entry: object, path: Path) -> tuple[int, str]:
    if not is_safe_name(name):
        raise _damaged(path, "checksums.files: names that stay in the folder", _short(name))
    if not isinstance(entry, dict) or not _is_digest(entry.get("digest")):
        raise _damaged(
            path, f"checksums.files[{name!r}].digest: 64 hexadecimal digits", _short(entry)
        )
    size = entry.get("size")
    if type(size) is not int or not 0 <= size < 1 << 63:
        raise _damaged(path, f"checksums.files[{name!r}].size: bytes", _short(size))
    return size, entry["digest"]


def _is_digest(value: object) -> bool:
    return isinstance(value, str) and len(value) == 64 and set(value) <= set("0123456789abcdef")


def _check_version(manifest: dict[str, Any], path: Path) -> None:
    version = manifest.get("format_version")
    if type(version) is not int or version < 1:
        raise _damaged(path, f"format_version: 1 to {FORMAT_VERSION}", _short(version))
    if version > FORMAT_VERSION:
        raise RunError(
            "the run is written in a newer format than this gamekeeper reads",
            where=str(path),
            expected=f"format_version {FORMAT_VERSION} or older",
            actual=f"format_version {_short(version)}",
            fix="upgrade: pip install --upgrade gamekeeper",
        )


def _check_depth(manifest: dict[str, Any], path: Path) -> None:
    level: list[Any] = [manifest]
    for _ in range(DEPTH):
        level = [
            child
            for node in level
            for child in (node.values() if isinstance(node, dict) else node)
            if isinstance(child, (dict, list))
        ]
        if not level:
            return
    raise _damaged(path, f"at most {DEPTH} levels of nesting", "more")


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON")


def _finite(text: str) -> float:
    number = float(text)
    if not isfinite(number):
        raise ValueError(f"{text[:40]} is too large a number")
    return number


def _short(value: object) -> str:
    try:
        text = repr(value)
    except ValueError:  # an integer with more digits than Python prints
        return "a number too large to print"
    return text if len(text) <= 100 else text[:97] + "..."


def _damaged(path: Path, expected: str, seen: str) -> RunError:
    return RunError(
        "the manifest is damaged",
        where=str(path),
        expected=expected,
        actual=seen,
        fix="restore manifest.json from a copy, or record the run again",
    )


# -- The error where there is no run: it names the runs in the folder, or the nearest beside it

MOST_LOOKED_AT: Final = 1_000
"""Entries of a folder among which runs are looked for; it may hold a great many."""
MOST_NAMED: Final = 5


def no_run(folder: Path) -> RunError:
    """The error that there is no run in `folder`; names runs in it, or the nearest beside it."""
    fix = "check the path; an environment is recorded first: gamekeeper rollout ENV --out RUN"
    if folder.is_dir():
        seen, inside = f"a folder without {MANIFEST}", _runs_in(folder)
        if inside:
            more = f" and {len(inside) - MOST_NAMED} more" if len(inside) > MOST_NAMED else ""
            fix = f"name one of the runs in it: {', '.join(map(repr, inside[:MOST_NAMED]))}{more}"
    elif folder.is_file():
        seen = "a file"
    else:
        seen = "no such folder"
        close = difflib.get_close_matches(folder.name, _runs_in(folder.parent), n=1)
        if close:
            fix = f"the nearest run there is {str(folder.with_name(close[0]))!r}"
    return RunError(
        "there is no run here",
        where=str(folder),
        expected=f"a folder with {MANIFEST}",
        actual=seen,
        fix=fix,
    )


def _runs_in(folder: Path) -> list[str]:
    """Names of the runs in a folder; empty if it can't be listed."""
    with suppress(OSError):
        entries = sorted(islice(folder.iterdir(), MOST_LOOKED_AT))
        return [entry.name for entry in entries if (entry / MANIFEST).is_file()]
    return []
