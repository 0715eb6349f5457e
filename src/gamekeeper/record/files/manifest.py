"""manifest.json: what a bundle is, read with suspicion and written in one exact spelling."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import BundleError, EvidenceError
from gamekeeper.record.files.folder import is_safe_name, read_bounded, reading

FORMAT_VERSION: Final = 1
MANIFEST: Final = "manifest.json"
MANIFEST_BYTES: Final = 64 << 20  # a manifest of 10,000 frames' digests has about 1.3 MB
DEPTH: Final = 200  # nested spaces are the deepest thing in it; the deepest seen have 6 levels
STATUSES: Final = ("open", "sealed", "recovered", "failed")
DIGEST: Final = "blake2b-256"


@dataclass(frozen=True, slots=True)
class Seal:
    """The digest of the manifest (without its seal) and of every sealed file's bytes.

    Args:
        manifest: hexadecimal blake2b-256 of the manifest's canonical JSON.
        files: by name, the size in bytes and the digest.
    """

    manifest: str
    files: dict[str, tuple[int, str]]

    def to_json(self) -> dict[str, Any]:
        """The seal as it stands in the manifest."""
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
        text = json.dumps(manifest, sort_keys=True, indent=1, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise EvidenceError(
            "the manifest can't be written as JSON",
            where=MANIFEST,
            seen=str(error),
            mend="encode NaN, infinities, bytes and objects as text first",
        ) from error
    return text.encode("ascii") + b"\n"


def manifest_digest(manifest: dict[str, Any]) -> str:
    """Digest of the canonical JSON of the manifest without its seal."""
    rest = {key: value for key, value in manifest.items() if key != "seal"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.blake2b(text.encode("ascii"), digest_size=32).hexdigest()


def load_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a bundle, with its version, status and seal of the right shape.

    Raises:
        BundleError: there is no bundle, its manifest is damaged, or a newer one than we read.
    """
    path = folder / MANIFEST
    if not path.exists() and not path.is_symlink():
        from gamekeeper.record.files.absent import no_bundle  # it names the manifest, too

        raise no_bundle(folder)
    return parse_manifest(read_bounded(path, MANIFEST_BYTES), path)


def parse_manifest(data: bytes, path: Path) -> dict[str, Any]:
    """The manifest that these bytes spell.

    Raises:
        BundleError: they spell none.
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
    seal_of(manifest, path)
    return manifest


def seal_of(manifest: dict[str, Any], path: Path) -> Seal | None:
    """The manifest's seal, None while the bundle is open.

    Raises:
        BundleError: the seal is missing where the status asks for one, or of the wrong shape.
    """
    if manifest["status"] == "open":
        return None
    seal = manifest.get("seal")
    if not isinstance(seal, dict):
        raise _damaged(path, f"a seal, since the status is {manifest['status']}", _short(seal))
    if seal.get("algorithm") != DIGEST:
        raise _damaged(path, f"seal.algorithm: {DIGEST}", _short(seal.get("algorithm")))
    files = seal.get("files")
    if not _is_digest(seal.get("manifest")) or not isinstance(files, dict):
        raise _damaged(path, "seal.manifest: a digest, seal.files: an object", _short(seal))
    return Seal(seal["manifest"], {name: _sealed(name, files[name], path) for name in files})


def _sealed(name: str, entry: object, path: Path) -> tuple[int, str]:
    if not is_safe_name(name):
        raise _damaged(path, "seal.files: names that stay in the folder", _short(name))
    if not isinstance(entry, dict) or not _is_digest(entry.get("digest")):
        raise _damaged(path, f"seal.files[{name!r}].digest: 64 hexadecimal digits", _short(entry))
    size = entry.get("size")
    if type(size) is not int or not 0 <= size < 1 << 63:
        raise _damaged(path, f"seal.files[{name!r}].size: bytes", _short(size))
    return size, entry["digest"]


def _is_digest(value: object) -> bool:
    return isinstance(value, str) and len(value) == 64 and set(value) <= set("0123456789abcdef")


def _check_version(manifest: dict[str, Any], path: Path) -> None:
    version = manifest.get("format_version")
    if type(version) is not int or version < 1:
        raise _damaged(path, f"format_version: 1 to {FORMAT_VERSION}", _short(version))
    if version > FORMAT_VERSION:
        raise BundleError(
            "the bundle is written in a newer format than this gamekeeper reads",
            where=str(path),
            expected=f"format_version {FORMAT_VERSION} or older",
            seen=f"format_version {_short(version)}",
            mend="upgrade: pip install --upgrade gamekeeper",
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


def _damaged(path: Path, expected: str, seen: str) -> BundleError:
    return BundleError(
        "the manifest is damaged",
        where=str(path),
        expected=expected,
        seen=seen,
        mend="restore manifest.json from a copy, or record the run again",
    )
