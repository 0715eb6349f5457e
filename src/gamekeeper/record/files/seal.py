"""The seal: digests of a bundle's bytes, and what differs from them.

A seal shows damage by accident. Who changes a file can also rewrite the seal: against intent,
compare the run's fingerprint with one that came from elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from gamekeeper.errors import BundleError
from gamekeeper.record.files.folder import (
    digest_file,
    inside,
    read_bounded,
    reading,
    replace,
    sync_files,
    sync_folder,
)
from gamekeeper.record.files.manifest import (
    MANIFEST,
    MANIFEST_BYTES,
    Seal,
    manifest_digest,
    parse_manifest,
    render,
    seal_of,
)
from gamekeeper.record.files.notes import NOTES, chain
from gamekeeper.record.files.schema import STREAMS
from gamekeeper.record.files.segments import SEGMENT

FRAMES = "frames"


@dataclass(frozen=True, slots=True)
class Damage:
    """A file that isn't as it was sealed.

    Args:
        file: its name in the bundle.
        what: "missing", "changed" or "extra" (it lies where evidence lies, but was never sealed).
        detail: what was expected and seen, for people.
    """

    file: str
    what: str
    detail: str = ""


def commit(
    folder: Path,
    manifest: dict[str, Any],
    files: dict[str, tuple[Path, int, str]],
    *,
    durable: bool = True,
) -> None:
    """Drafts become the bundle's Parquet files, the manifest seals them, the segments go.

    Killed anywhere in between, the bundle can be read: a Parquet file holds what its segments hold,
    and the manifest says "open" until everything that it seals is there. So it is after a power cut
    too: bytes are on the disk before their names, names before the manifest that seals them, the
    manifest before a segment goes.

    Args:
        folder: the bundle.
        manifest: what the manifest says besides the seal.
        files: by stream, the draft, its size and its digest.
        durable: False leaves out what is for power cuts: nothing is synced.
    Raises:
        BundleError: the disk refuses.
    """
    sealed = {f"{stream}.parquet": (size, hash_) for stream, (_, size, hash_) in files.items()}
    frames = {name: inside(folder, name) for name in frame_names(folder)}
    sealed |= {name: digest_file(path) for name, path in frames.items()}
    rest = {key: value for key, value in manifest.items() if key != "seal"}
    seal = Seal(manifest_digest(rest), sealed)
    data = render({**rest, "seal": seal.to_json()})
    if durable:
        sync_files([*(draft for draft, _, _ in files.values()), *frames.values()])
    for stream, (draft, _, _) in files.items():
        draft.replace(folder / f"{stream}.parquet")
    if durable:
        for inner in (*sorted({path.parent for path in frames.values()}), folder):
            sync_folder(inner)
    replace(folder / MANIFEST, data, durable=durable)
    for path in list(folder.iterdir()):
        if SEGMENT.fullmatch(path.name):
            path.unlink(missing_ok=True)


def check_seal(path: str | PathLike[str]) -> tuple[Damage, ...]:
    """What of a sealed bundle isn't as it was sealed; empty where every byte is.

    Annotations are added after sealing: `verify_notes` looks at them.

    Raises:
        BundleError: there is no sealed bundle here, or its manifest is too damaged to hold a seal.
    """
    folder = Path(path)
    with reading(folder):
        return tuple(_damages(folder))


def _damages(folder: Path) -> list[Damage]:
    data = read_bounded(inside(folder, MANIFEST), MANIFEST_BYTES)
    manifest = parse_manifest(data, folder / MANIFEST)
    seal = seal_of(manifest, folder / MANIFEST)
    if seal is None:
        raise BundleError(
            "the bundle was never sealed",
            where=str(folder),
            expected="status sealed, recovered or failed",
            seen="status open",
            mend="wait until its recorder closes it, or run `gamekeeper recover`",
        )
    found = []
    if manifest_digest(manifest) != seal.manifest or render(manifest) != data:
        found.append(Damage(MANIFEST, "changed", "its bytes aren't those that were sealed"))
    for name, sealed in seal.files.items():
        found += _compare(folder, name, sealed)
    streams = [f"{stream}.parquet" for stream in STREAMS]
    lying = [name for name in streams if (folder / name).exists()] + frame_names(folder)
    found += [Damage(name, "extra", "never sealed") for name in lying if name not in seal.files]
    return found


def verify_notes(path: str | PathLike[str]) -> tuple[Damage, ...]:
    """Where the chain of a bundle's annotations is broken; empty where it holds.

    Raises:
        BundleError: the annotations are no plain file.
    """
    folder = Path(path)
    with reading(folder):
        broken = [f"line {number} {why}" for number, _, why in chain(folder) if why]
    return tuple(Damage(NOTES, "changed", why) for why in broken)


def frame_names(folder: Path) -> list[str]:
    """Names, relative to the bundle, of everything in its folder of frames, sorted."""
    frames = folder / FRAMES
    if frames.is_symlink():
        return [FRAMES]  # not a folder of ours; whoever opens it is told so
    found = (path for path in frames.rglob("*") if path.is_symlink() or not path.is_dir())
    return sorted(path.relative_to(folder).as_posix() for path in found)


def _compare(folder: Path, name: str, sealed: tuple[int, str]) -> list[Damage]:
    path = inside(folder, name)
    if not path.exists():
        return [Damage(name, "missing")]
    size, digest = digest_file(path)
    if size != sealed[0]:
        return [Damage(name, "changed", f"{size} bytes, sealed with {sealed[0]}")]
    return [] if digest == sealed[1] else [Damage(name, "changed", "other bytes than were sealed")]
