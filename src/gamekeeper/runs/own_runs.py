"""Own runs: root digests of what this user recorded here, and the files that it was imported from.

A file for each run lies in the user's own state folder. An own run is played again without a flag
as long as it and those files are unchanged. Recording never fails for want of that folder: the run
counts as anybody's then.
"""

import json
import os
import secrets
import stat
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import RunError
from gamekeeper.import_guard import digest_of, site_folders
from gamekeeper.interface.modules import file_module
from gamekeeper.runs.files.checksums import root_digest
from gamekeeper.runs.files.folder import READ_FLAGS, write_new

FORMAT: Final = 1
MOST: Final = 5_000
"""Runs that are remembered; beyond, the oldest are forgotten."""
MOST_BYTES: Final = 1 << 24
"""Bytes remembered of a run."""
NOT_ASKED: Final = ("__main__", "__mp_main__", "gamekeeper")
"""Packages that no replay imports on a run's behalf."""

Modules = Mapping[str, tuple[str, str]]
"""File and digest by the name of a module."""


def remember(folder: Path, modules: Modules | None = None) -> None:
    """Counts the run in `folder`, just finalized, as this user's own from now on.

    Args:
        modules: modules that it was imported from; None: all that this process has imported.
    """
    place = _place()
    with suppress(OSError, RunError):  # recording never fails for it
        root = root_digest(folder, check=False)
        if place is None or root is None:
            return
        place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        place.mkdir(mode=0o700, exist_ok=True)
        if not (is_private(place.parent) and is_private(place)):
            return
        found = imported_modules() if modules is None else modules
        _write(place / f"{root}.json", {"format": FORMAT, "modules": found})
        files = list(place.glob("*.json"))
        if len(files) > MOST:  # the oldest are forgotten, some more than necessary at a time
            files.sort(key=lambda file: file.stat().st_mtime)
            for file in files[: len(files) - MOST + MOST // 10]:
                file.unlink(missing_ok=True)


def recall(root: str | None) -> Modules | None:
    """Modules that the own run with this root digest was imported from; None for another's run."""
    place = _place()
    if place is None or root is None:
        return None
    file = place / f"{root}.json"
    try:
        if not all(map(is_private, (place.parent, place, file))):
            return None
        document = json.loads(_read(file))
        if document["format"] != FORMAT:
            return None
        return {
            str(name): (str(path), str(digest))
            for name, (path, digest) in document["modules"].items()
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None  # not there, or nothing that `remember` wrote


def forget(root: str | None) -> None:
    """Counts the run with this root digest as another's."""
    place = _place()
    if place is not None and root is not None:
        with suppress(OSError):
            (place / f"{root}.json").unlink()


def changed(modules: Modules) -> list[str]:
    """Files that aren't as they were when the run was recorded."""
    return sorted(path for path, digest in modules.values() if _digest(path) != digest)


def imported_modules() -> dict[str, tuple[str, str]]:
    """Modules of this process from outside the standard library and installed packages."""
    ours = Path(__file__).parents[1]  # a worker's own script, where it isn't installed
    folders = (*site_folders(), str(ours))
    installed = tuple({f"{each}{os.sep}" for f in folders for each in (f, os.path.realpath(f))})
    found = {}
    for name, module in list(sys.modules.items()):
        path = _path_of(module)
        if path is not None and name == "__main__" and path.endswith(".py"):
            name = _script(path)
        if path is None or name.partition(".")[0] in NOT_ASKED or path.startswith(installed):
            continue
        digest = _digest(path)
        if digest is not None:
            found[name] = (str(Path(path).absolute()), digest)
    return found


def _script(path: str) -> str:
    """Name under which a replay loads the file of the script that records."""
    try:
        return file_module(Path(path).resolve(), Path(path).read_bytes())
    except OSError:
        return "__main__"


def _path_of(module: Any) -> str | None:
    """The file of a module; of a namespace package, its folder; None where it doesn't say."""
    try:  # modules answer by code of their own, namespace packages by asking their parent
        path = getattr(module, "__file__", None)
        if path is None:
            path = next(iter(getattr(module, "__path__", ())), None)
    except Exception:
        return None
    return path if isinstance(path, str) else None


def _digest(path: str) -> str | None:
    try:
        return "" if Path(path).is_dir() else digest_of(Path(path).read_bytes())
    except (OSError, ValueError):
        return None


def _place() -> Path | None:
    """The folder of own runs; None where the account has no home."""
    try:
        return user_folder("STATE", ".local/state", "Application Support") / "own-runs"
    except RuntimeError:
        return None


def user_folder(kind: str, usual: str, apple: str) -> Path:
    """The user's own folder for files of ours.

    Args:
        kind: names the variable: `XDG_KIND_HOME`.
        usual: its place in the home folder where the variable names none.
        apple: its place in the Library of macOS.
    Raises:
        RuntimeError: the account has no home.
    Source: XDG Base Directory Specification; elsewhere the folders of Apple and Windows.
    """
    base = Path(os.environ.get(f"XDG_{kind}_HOME", ""))
    if not base.is_absolute():
        home = Path.home()
        base = home / usual
        if sys.platform == "darwin":
            base = home / "Library" / apple
        elif sys.platform == "win32":
            base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    return base / "gamekeeper"


def is_private(path: Path) -> bool:
    """True if it belongs to this user, is no link, and only this user may write into it."""
    seen = path.lstat()
    is_plain = stat.S_ISDIR(seen.st_mode) or stat.S_ISREG(seen.st_mode)
    user = getattr(os, "geteuid", None)
    if user is None:  # not POSIX: the user's folder is private by the system's own rules
        return is_plain
    return is_plain and seen.st_uid == user() and not seen.st_mode & 0o022


def _read(path: Path) -> bytes:
    with os.fdopen(os.open(path, READ_FLAGS), "rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError("larger than anything that was written here")
    return data


def _write(path: Path, document: Mapping[str, Any]) -> None:
    draft = path.with_name(f".{path.stem[:16]}.{secrets.token_hex(6)}")
    try:
        write_new(draft, json.dumps(document).encode(), mode=0o600)
        draft.replace(path)
    except BaseException:
        with suppress(OSError):
            draft.unlink()
        raise
