"""Takes a folder for a new bundle, so that two recorders never write into one."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path
from typing import Final

from gamekeeper.errors import BundleError
from gamekeeper.record.files.folder import (
    NEW_FLAGS,
    sync_folder,
    system_error,
    take_lock,
    write_all,
)
from gamekeeper.record.files.manifest import MANIFEST

DRAFT: Final = MANIFEST + ".tmp"


def claim(folder: Path, manifest: bytes, *, durable: bool = True) -> int:
    """The folder exists, holds this manifest and nothing else, and is locked for this process.

    Args:
        folder: doesn't exist yet, or is empty.
        manifest: its bytes.
        durable: it survives a power cut from now on.
    Returns:
        The descriptor that holds the lock; -1 where the system has none for folders.
    Raises:
        BundleError: something lies there, the path can't be a folder, or the disk refuses.
    """
    _refuse_no_text(folder)
    made = not os.path.lexists(folder)
    lock = -1
    try:
        _make(folder, durable=durable)
        _refuse_taken(folder, but=())
        lock = lock_folder(folder)
        _publish(folder, manifest, durable=durable)
    except BaseException as error:  # also Ctrl-C
        if lock >= 0:
            os.close(lock)
        if made and not isinstance(error, FileExistsError):
            _remove_empty(folder)
        if isinstance(error, BundleError) or not isinstance(error, OSError | ValueError):
            raise
        raise _no_folder(folder, error) from error
    return lock


def lock_folder(folder: Path) -> int:
    """A descriptor that holds the folder's lock until it is closed or the process ends.

    Raises:
        BundleError: another process holds it, or there is no such folder.
    """
    if os.name == "nt":
        return -1
    try:
        descriptor = os.open(folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    except OSError as error:
        raise system_error("locking the folder", folder, error) from error
    if take_lock(descriptor, wait=False):
        return descriptor
    os.close(descriptor)
    raise BundleError(
        "the bundle is being recorded by another process",
        where=str(folder),
        mend="wait until it ends (also processes that it started), or record into another folder",
    )


def _refuse_no_text(folder: Path) -> None:
    """Refuses what is no UTF-8: Arrow's writers, and others who read a bundle, can't name it."""
    try:
        str(folder).encode()
    except UnicodeEncodeError:
        raise BundleError(
            "the folder's name is no UTF-8",
            where=ascii(str(folder))[:200],
            mend="choose a name that other programs can read, too",
        ) from None


def _make(folder: Path, *, durable: bool) -> None:
    """The folder and its parents are there, `durable`: also after a power cut."""
    missing = [path for path in (folder, *folder.parents) if durable and not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        sync_folder(path.parent)


def _publish(folder: Path, manifest: bytes, *, durable: bool) -> None:
    # The draft is made only where none is, which decides between two that came this far at once;
    # the name manifest.json never shows half a manifest.
    draft = folder / DRAFT
    descriptor = os.open(draft, NEW_FLAGS, 0o666)
    try:
        try:
            write_all(descriptor, manifest)
            if durable:
                os.fsync(descriptor)
        finally:
            os.close(descriptor)
        _refuse_taken(folder, but=(DRAFT,))
        draft.replace(folder / MANIFEST)
        if durable:
            sync_folder(folder)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def _refuse_taken(folder: Path, *, but: tuple[str, ...]) -> None:
    names = sorted({path.name for path in folder.iterdir()} - set(but))
    if names:
        raise BundleError(
            "a bundle is there already" if MANIFEST in names else "the folder isn't empty",
            where=str(folder),
            expected="a folder that doesn't exist yet, or is empty",
            seen=", ".join(names[:5]) + (", ..." if len(names) > 5 else ""),
            mend="choose another folder, or move this one away first",
        )


def _remove_empty(folder: Path) -> None:
    with suppress(OSError, ValueError):  # something lies there after all, or it was never made
        folder.rmdir()


def _no_folder(folder: Path, error: OSError | ValueError) -> BundleError:
    if isinstance(error, FileExistsError):
        if folder.is_dir():
            return BundleError(
                "another process is making a bundle here",
                where=str(folder),
                mend=f"choose another folder; if nothing is running, remove {DRAFT} there",
            )
        error = OSError(errno.ENOTDIR, "a file has this name")
    if not isinstance(error, OSError):
        return BundleError(f"no folder can have this name: {error}", where=repr(folder)[:200])
    return system_error("making the folder", folder, error)
