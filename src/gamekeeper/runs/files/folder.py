"""The folder of a run: names that stay inside, plain files, whole replacements, one recorder."""

import errno
import hashlib
import os
import re
import stat
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from os import PathLike, fspath
from pathlib import Path
from typing import BinaryIO, Final

from gamekeeper.episodes.plain_json import is_damage
from gamekeeper.errors import EvidenceError, GamekeeperError, RunError

# -- The files of a run's folder: names that stay inside, plain files, whole replacements
#
# Nothing here knows what the files mean. Every error of the operating system leaves as a
# RunError that names the file and the fix.

MANIFEST: Final = "manifest.json"

NO_FOLLOW: Final[int] = getattr(os, "O_NOFOLLOW", 0)
# Without O_NONBLOCK, opening a pipe that lies where a file should be waits for ever.
READ_FLAGS: Final[int] = (
    os.O_RDONLY | NO_FOLLOW | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
)
NEW_FLAGS: Final[int] = (
    os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_FOLLOW | getattr(os, "O_BINARY", 0)
)
NAME_CHARACTERS: Final[int] = 255  # of one part of a name, as common file systems allow
HASH_BYTES: Final = 1 << 20
SYNCED_TOGETHER: Final = 64  # files open at a time
# What file systems answer that keep no folders to be synced (FUSE, SMB).
UNSYNCED: Final = (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EBADF)
# Windows reads these as devices, whatever follows the first dot.
DEVICE: Final = re.compile(r"(?i)(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?")

FIXES: Final[dict[int, str]] = {
    errno.ENOSPC: "free some space; what was written before this is whole and can be recovered",
    errno.EDQUOT: "free some of your quota; what was written before this can be recovered",
    errno.EFBIG: "raise the limit on file sizes (ulimit -f)",
    errno.EACCES: "choose a folder that you may write to",
    errno.EPERM: "choose a folder that you may write to",
    errno.EROFS: "choose a folder on a disk that isn't read-only",
    errno.ENOTDIR: "choose a path of which every part is a folder",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.EMFILE: "raise the limit on open files (ulimit -n), or close what holds them",
    errno.EIO: "check the disk; what was written before this may be recovered",
}


def system_error(doing: str, path: Path, error: OSError) -> RunError:
    """A RunError that says what the operating system refused and what to do about it."""
    reason = error.strerror or str(error) or type(error).__name__
    fix = FIXES.get(error.errno or 0, "look at the folder and try again")
    return RunError(f"{doing} failed: {reason}", where=str(path), fix=fix)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raises a RunError naming the file for any error of a decoder on damaged bytes.

    What no damage raises is a fault of ours, and leaves as it is.
    """
    try:
        yield
    except GamekeeperError:
        raise
    except Exception as error:
        if not is_damage(error):
            raise
        text = (str(error) or type(error).__name__).splitlines()[0][:300]
        raise RunError(
            f"{path.name} can't be read",
            where=str(path),
            actual=text,
            fix="allow more memory; if that doesn't help, the file is damaged"
            if isinstance(error, MemoryError)
            else "restore the file from a copy, or record the run again",
        ) from error


def is_safe_name(name: object) -> bool:
    """True where `name` is a relative path that stays in its folder on every operating system."""
    if not isinstance(name, str) or not name or "\\" in name or ":" in name:
        return False
    parts = name.split("/")
    if any(ord(letter) < 32 or 0xD800 <= ord(letter) <= 0xDFFF for letter in name):
        return False
    return all(
        part not in ("", ".", "..")
        and len(part) <= NAME_CHARACTERS
        and part[-1] not in ". "
        and not DEVICE.fullmatch(part)
        for part in parts
    )


def inside(folder: Path, name: str) -> Path:
    """The path of `name` in the folder, checked part by part: no link on the way is followed.

    Raises:
        RunError: the name could leave the folder, or a part of it is a link.
    """
    if not is_safe_name(name):
        raise RunError(
            "a file's name would leave the run",
            where=str(folder),
            expected="a relative name without '..', drive or backslash",
            actual=repr(name)[:200],
            fix="don't trust this run: ask its author for another copy",
        )
    path = folder
    for part in name.split("/"):
        path = path / part
        if path.is_symlink():
            raise RunError(
                f"{name} is a link, and a run holds only plain files",
                where=str(path),
                fix="put the file itself in the link's place",
            )
    return path


def open_plain(path: Path) -> BinaryIO:
    """A plain file opened for reading; a link, pipe, folder or device is refused.

    Raises:
        RunError: the file is missing, unreadable or not plain.
    """
    try:
        descriptor = os.open(path, READ_FLAGS)
    except FileNotFoundError as error:
        raise RunError(
            f"{path.name} is missing", where=str(path), fix="restore the file from a copy"
        ) from error
    except OSError as error:
        raise system_error(f"opening {path.name}", path, error) from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise RunError(
            f"{path.name} is not a plain file",
            where=str(path),
            fix="put a plain file in its place, or restore the run from a copy",
        )
    return os.fdopen(descriptor, "rb", buffering=0)


def read_bounded(path: Path, limit_bytes: int) -> bytes:
    """The bytes of a plain file that may not be longer than the limit."""
    with open_plain(path) as file:
        size_bytes = os.fstat(file.fileno()).st_size
        if size_bytes > limit_bytes:
            raise RunError(
                f"{path.name} is larger than such a file can be",
                where=str(path),
                expected=f"at most {limit_bytes} bytes",
                actual=f"{size_bytes} bytes",
                fix="restore the file from a copy",
            )
        with reading(path):
            return file.read(limit_bytes + 1)


def digest_file(path: Path) -> tuple[int, str]:
    """Size in bytes and blake2b-256 of a plain file.

    Raises:
        RunError: the file is missing or unreadable.
    """
    digest, size = hashlib.blake2b(digest_size=32), 0
    with open_plain(path) as file, reading(path):
        while data := file.read(HASH_BYTES):
            digest.update(data)
            size += len(data)
    return size, digest.hexdigest()


def write_all(descriptor: int, data: bytes | bytearray | memoryview) -> None:
    """Every byte is handed to the operating system, however many calls that takes."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def write_new(path: Path, data: bytes, *, durable: bool = False, mode: int = 0o666) -> None:
    """Writes a file that isn't there yet; `durable`: its bytes are on the disk when this returns.

    Raises:
        OSError: it is there, or the disk refuses.
    """
    descriptor = os.open(path, NEW_FLAGS, mode)
    try:
        write_all(descriptor, data)
        if durable:
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


def replace(path: Path, data: bytes, *, durable: bool = True) -> None:
    """Writes a file that holds either its old bytes or all new ones, whenever the process dies.

    Raises:
        RunError: the disk refuses.
    """
    temporary = path.with_name(path.name + ".tmp")
    try:
        temporary.unlink(missing_ok=True)
        write_new(temporary, data, durable=durable)
        temporary.replace(path)
        if durable:
            sync_folder(path.parent)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise system_error(f"writing {path.name}", path, error) from error
        raise


def sync_files(paths: Sequence[Path]) -> None:
    """Makes the content of many files survive a power cut.

    Writing all of them is begun before the first one is waited for: one after the other, each would
    wait for a commit of the file system's journal (measured: 150 files 0.2 s in place of 1.4).
    """
    flags = os.O_RDWR | getattr(os, "O_BINARY", 0)
    advise = getattr(os, "posix_fadvise", None)  # Linux; macOS and Windows have neither
    not_needed = getattr(os, "POSIX_FADV_DONTNEED", 0)
    for first in range(0, len(paths), SYNCED_TOGETHER):
        with ExitStack() as opened:
            descriptors = []
            for path in paths[first : first + SYNCED_TOGETHER]:
                descriptors.append(os.open(path, flags))
                opened.callback(os.close, descriptors[-1])
                if advise is not None:
                    advise(descriptors[-1], 0, 0, not_needed)
            for descriptor in descriptors:
                os.fsync(descriptor)


def sync_folder(folder: Path) -> None:
    """The folder's names survive a power cut, where the system lets a folder be synced."""
    try:  # Windows opens no folder
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:  # one may write into it, and not look
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in UNSYNCED:
            raise
    finally:
        os.close(descriptor)


def take_lock(descriptor: int, *, wait: bool) -> bool:
    """True where this process now holds the file's lock, until the descriptor is closed.

    Where the system or the file system has no such locks, everyone holds it.
    """
    with suppress(ImportError, OSError):  # network file systems may know no locks
        import fcntl

        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            return False
    return True


# -- Claims a folder for a new run, so that two recorders never write into one

DRAFT: Final = MANIFEST + ".tmp"


def claim(folder: Path, manifest: bytes, *, durable: bool = True) -> int:
    """Makes the folder, with this manifest and nothing else in it, locked for this process.

    Args:
        folder: doesn't exist yet, or is empty.
        manifest: its bytes.
        durable: it survives a power cut from now on.
    Returns:
        The descriptor that holds the lock; -1 where the system has none for folders.
    Raises:
        RunError: something lies there, the path can't be a folder, or the disk refuses.
    """
    try:  # Arrow's writers and other programs can't name what isn't UTF-8
        str(folder).encode()
    except UnicodeEncodeError:
        raise RunError(
            "the folder's name isn't UTF-8",
            where=ascii(str(folder))[:200],
            fix="choose a name that other programs can read, too",
        ) from None
    made = not os.path.lexists(folder)
    lock = -1
    try:
        _make(folder, durable=durable)
        refuse_taken(folder)
        lock = lock_folder(folder)
        _publish(folder, manifest, durable=durable)
    except BaseException as error:  # also Ctrl-C
        if lock >= 0:
            os.close(lock)
        if made and not isinstance(error, FileExistsError):
            with suppress(OSError, ValueError):  # something lies there, or it was never made
                folder.rmdir()
        if isinstance(error, RunError) or not isinstance(error, OSError | ValueError):
            raise
        raise _no_folder(folder, error) from error
    return lock


def lock_folder(folder: Path) -> int:
    """A descriptor that holds the folder's lock until it is closed or the process ends.

    Raises:
        RunError: another process holds it, or there is no such folder.
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
    raise RunError(
        "the run is being recorded by another process",
        where=str(folder),
        fix="wait until it ends (also processes that it started), or record into another folder",
    )


def _make(folder: Path, *, durable: bool) -> None:
    """Makes the folder and its parents; `durable`: they survive a power cut."""
    missing = [path for path in (folder, *folder.parents) if durable and not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        sync_folder(path.parent)


def _publish(folder: Path, manifest: bytes, *, durable: bool) -> None:
    # The draft is made only where none is, which decides between two that came this far at once:
    # the name manifest.json never shows half a manifest.
    draft = folder / DRAFT
    try:
        write_new(draft, manifest, durable=durable)
        refuse_taken(folder, but=(DRAFT,))
        draft.replace(folder / MANIFEST)
        if durable:
            sync_folder(folder)
    except FileExistsError:  # this draft is the other one's
        raise
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def refuse_taken(folder: Path, *, but: tuple[str, ...] = ()) -> None:
    """Refuses a folder in which something lies, but for the names in `but`."""
    names = sorted({path.name for path in folder.iterdir()} - set(but))
    if names:
        raise RunError(
            "a run is there already" if MANIFEST in names else "the folder isn't empty",
            where=str(folder),
            expected="a folder that doesn't exist yet, or is empty",
            actual=", ".join(names[:5]) + (", ..." if len(names) > 5 else ""),
            fix=f"name another folder, such as {free_beside(folder)}, or move this one away first",
        )


@contextmanager
def renamed_when_whole(folder: Path, *, mode: int = 0o777) -> Iterator[Path]:
    """An empty folder beside `folder`, which gets its name where the block ends without an error.

    What a killed process leaves is never at `folder`.

    Args:
        mode: permissions that it is made with; the umask is taken off.
    Raises:
        RunError: something lies in `folder`, also when the block ends, or it can't be made.
    """
    folder = folder.resolve()  # a link to an empty folder stays
    with making(folder):
        folder.parent.mkdir(mode=mode, parents=True, exist_ok=True)
        if os.path.lexists(folder):
            refuse_taken(folder)
        own = tempfile.TemporaryDirectory(
            prefix=f".{folder.name[:64]}-", dir=folder.parent, ignore_cleanup_errors=True
        )
    with own:
        draft = Path(own.name) / folder.name
        with making(folder):
            draft.mkdir(mode=mode)
        yield draft
        with making(folder):
            if folder.exists():
                folder.rmdir()
            draft.rename(folder)


@contextmanager
def making(folder: Path) -> Iterator[None]:
    """Raises a RunError for what the operating system refuses while `folder` is made."""
    try:
        yield
    except RunError:
        raise
    except (OSError, ValueError) as error:
        raise _no_folder(folder, error) from error


def free_beside(folder: Path) -> Path:
    """The first of `folder-2`, `folder-3`, ... that doesn't exist; `folder-7` counts on from 8."""
    stem = folder if folder.name else folder / "run"
    name, _, number = stem.name.rpartition("-")
    if not (name and number.isdecimal() and len(number) <= 6):
        name, number = stem.name, "1"
    numbered = (stem.with_name(f"{name}-{n}") for n in count(int(number) + 1))
    return next(path for path in numbered if not os.path.lexists(path))


def _no_folder(folder: Path, error: OSError | ValueError) -> RunError:
    if isinstance(error, FileExistsError):
        if folder.is_dir():
            return RunError(
                "another process is making a run here",
                where=str(folder),
                fix=f"choose another folder; if nothing is running, remove {DRAFT} there",
            )
        error = OSError(errno.ENOTDIR, "a file has this name")
    if not isinstance(error, OSError):
        return RunError(
            f"no folder can have this name: {error}",
            where=repr(folder)[:200],
            fix="choose another name",
        )
    return system_error("making the folder", folder, error)


def output_path(out: str | PathLike[str] | None, *, suffix: str = "") -> Path:
    """The path of a file to write, over an earlier one; its folder is made.

    Raises:
        EvidenceError: none was named.
        RunError: a folder or a link has the name, the file is part of a run, or its folder can't be
            made.
    """
    if out is None:
        raise EvidenceError("no file is named", where="--out", fix=f"--out demo{suffix}")
    path = Path(fspath(out))
    if suffix and path.name and path.suffix != suffix:  # `.` has no name, and is a folder
        path = path.with_name(path.name + suffix)
    is_evidence = path.exists() and (path.parent / MANIFEST).exists()
    if path.is_dir() or path.is_symlink() or is_evidence:
        kind = "a file of a run" if is_evidence else "a folder" if path.is_dir() else "a link"
        raise RunError(
            f"{kind} has this name, and isn't overwritten",
            where=str(path),
            expected="a new file, or an earlier one of the same kind",
            actual=kind,
            fix=f"--out {path.name or f'demo{suffix}'} in another folder"
            if is_evidence
            else "name a file",
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(
            f"making the folder failed: {error.strerror}",
            where=str(path.parent),
            fix="choose a folder that you may write to",
        ) from error
    return path
