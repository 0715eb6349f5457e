"""Checksums of a run: of its files, of its annotations, and the root digest over every byte."""

import hashlib
import os
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from gamekeeper.errors import RunError
from gamekeeper.runs.files.folder import (
    MANIFEST,
    digest_file,
    inside,
    read_bounded,
    reading,
    replace,
    sync_files,
    sync_folder,
)
from gamekeeper.runs.files.manifest import (
    MANIFEST_BYTES,
    Checksums,
    checksums_of,
    manifest_digest,
    parse_manifest,
    render,
)
from gamekeeper.runs.files.notes import NOTES, chain
from gamekeeper.runs.files.schema import STREAMS
from gamekeeper.runs.files.segments import JOURNAL, SEGMENT

# -- The checksums: digests of a run's bytes, and what differs from them
#
# Checksums show damage by accident. Whoever changes a file on purpose can also rewrite the
# checksums: compare the run's root digest with one that came from elsewhere.

FRAMES = "frames"


@dataclass(frozen=True, slots=True)
class Damage:
    """A file that isn't as it was finalized.

    Args:
        file: its name in the run.
        what: "missing", "changed" or "extra" (it lies where evidence lies, but was never
            finalized).
        detail: expected and actual, for people.
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
    """Makes drafts the run's Parquet files, finalizes them by the manifest, removes the segments.

    Killed anywhere in between, the run can be read: a Parquet file holds what its segments hold,
    and the manifest says "open" until everything that it finalizes is there. The same holds after
    a power cut: bytes are on the disk before their names, names before the manifest that finalizes
    them, the manifest before a segment goes.

    Args:
        manifest: all fields but the checksums.
        files: by stream, the draft, its size and its digest.
        durable: False leaves out what is for power cuts: nothing is synced.
    Raises:
        RunError: the disk refuses.
    """
    finalized = {f"{stream}.parquet": (size, hash_) for stream, (_, size, hash_) in files.items()}
    frames = {name: inside(folder, name) for name in frame_names(folder)}
    finalized |= {name: digest_file(path) for name, path in frames.items()}
    rest = {key: value for key, value in manifest.items() if key != "checksums"}
    checksums = Checksums(manifest_digest(rest), finalized)
    data = render({**rest, "checksums": checksums.to_json()})
    if durable:  # bytes, before a name says that they are there
        sync_files([*(draft for draft, _, _ in files.values()), *frames.values()])
    for stream, (draft, _, _) in files.items():
        draft.replace(folder / f"{stream}.parquet")
    if durable:  # names, before the manifest that finalizes them
        for inner in (*sorted({path.parent for path in frames.values()}), folder):
            sync_folder(inner)
    replace(folder / MANIFEST, data, durable=durable)
    # Last of all: up to here the segments hold the run, whatever became of the rest.
    for path in list(folder.iterdir()):
        if path.name == JOURNAL or SEGMENT.fullmatch(path.name.removesuffix(".tmp")):
            path.unlink(missing_ok=True)


def compare_checksums(path: str | PathLike[str]) -> tuple[Damage, ...]:
    """Damage of a finalized run; empty where every byte is as it was finalized.

    Annotations are added after finalizing: `verify_notes` looks at them.

    Raises:
        RunError: there is no finalized run here, or its manifest is too damaged to hold checksums.
    """
    folder = Path(path)
    with reading(folder):
        data, manifest, checksums = _manifest_of(folder)
        return tuple(_damages(folder, data, manifest, checksums))


def _manifest_of(folder: Path) -> tuple[bytes, dict[str, Any], Checksums | None]:
    """The bytes of a run's manifest, its fields, and its checksums."""
    data = read_bounded(inside(folder, MANIFEST), MANIFEST_BYTES)
    manifest = parse_manifest(data, folder / MANIFEST)
    return data, manifest, checksums_of(manifest, folder / MANIFEST)


def _damages(
    folder: Path, data: bytes, manifest: dict[str, Any], checksums: Checksums | None
) -> list[Damage]:
    if checksums is None:
        raise RunError(
            "the run was never finalized",
            where=str(folder),
            expected="status finalized, recovered or failed",
            actual="status open",
            fix="wait until its recorder closes it, or run `gamekeeper recover`",
        )
    found = []
    if manifest_digest(manifest) != checksums.manifest or render(manifest) != data:
        found.append(Damage(MANIFEST, "changed", "its bytes aren't those that were finalized"))
    streams = [f"{stream}.parquet" for stream in STREAMS]
    present = [name for name in streams if (folder / name).exists()] + frame_names(folder)
    for name in dict.fromkeys([*checksums.files, *present]):
        found += file_damage(folder, name, checksums)
    return found


def verify_notes(path: str | PathLike[str]) -> tuple[Damage, ...]:
    """Breaks in the chain of a run's annotations; empty where it holds.

    Raises:
        RunError: the annotations are no plain file.
    """
    folder = Path(path)
    with reading(folder):
        broken = [f"line {number} {why}" for number, _, why in chain(folder) if why]
    return tuple(Damage(NOTES, "changed", why) for why in broken)


def frame_names(folder: Path) -> list[str]:
    """Names, relative to the run, of everything in its folder of frames, sorted."""
    frames = folder / FRAMES
    if frames.is_symlink():
        return [FRAMES]  # opening it says that it is no folder of ours
    found = (path for path in frames.rglob("*") if path.is_symlink() or not path.is_dir())
    return sorted(path.relative_to(folder).as_posix() for path in found)


def file_damage(folder: Path, name: str, checksums: Checksums) -> list[Damage]:
    """Damage of one file of a finalized run, by its checksum; empty where there is none.

    Raises:
        RunError: it is no plain file, or can't be read.
    """
    finalized = checksums.files.get(name)
    if finalized is None:
        is_there = os.path.lexists(folder / name)
        return [Damage(name, "extra", "never finalized")] if is_there else []
    path = inside(folder, name)
    if not path.exists():
        return [Damage(name, "missing")]
    size, digest = digest_file(path)
    if size != finalized[0]:
        return [Damage(name, "changed", f"{size} bytes, finalized with {finalized[0]}")]
    is_same = digest == finalized[1]
    return [] if is_same else [Damage(name, "changed", "other bytes than were finalized")]


# -- The root digest: one digest over every byte of a finalized run


def root_digest(path: str | PathLike[str], *, check: bool = True) -> str | None:
    """Root digest of a run; None while it is recorded, or where it was never finalized.

    It is what `b2sum -l 256 FILES | b2sum -l 256` prints for the manifest and the files that the
    manifest names, sorted by name. Annotations are added later and don't change it; what else lies
    in the folder isn't part of the run.

    Args:
        check: read every file; False takes the digests that the manifest names, for files that
            were compared with these already.
    Raises:
        RunError: there is no run, its manifest is damaged, or a file can't be read.
    """
    folder = Path(path)
    with reading(folder):
        data, _, checksums = _manifest_of(folder)
        if checksums is None:
            return None
        digests = {name: digest for name, (_, digest) in checksums.files.items()}
        if check:
            digests = {name: digest_file(inside(folder, name))[1] for name in digests}
        digests[MANIFEST] = hashlib.blake2b(data, digest_size=32).hexdigest()
    listed = "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))
    return hashlib.blake2b(listed.encode(), digest_size=32).hexdigest()


def strays(path: str | PathLike[str]) -> tuple[str, ...]:
    """Names of entries in the folder of a finalized run that are no part of it, sorted.

    A folder is named with a slash, without its content; a strange file among the frames is damage,
    as `compare_checksums` says.

    Raises:
        RunError: there is no run, or its manifest is damaged.
    """
    folder = Path(path)
    with reading(folder):
        _, _, checksums = _manifest_of(folder)
        if checksums is None:
            return ()
        streams = {f"{stream}.parquet" for stream in STREAMS}  # one too many is damage
        own = {MANIFEST, NOTES, *streams, *(name.partition("/")[0] for name in checksums.files)}
        found = sorted(folder.iterdir())
    return tuple(
        f"{entry.name}/" if entry.is_dir() and not entry.is_symlink() else entry.name
        for entry in found
        if entry.name not in own
    )
