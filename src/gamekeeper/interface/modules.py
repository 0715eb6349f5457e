"""Loading a module by its name or a file by its path, with the folders it counts on."""

import contextlib
import difflib
import functools
import importlib
import importlib.metadata
import importlib.util
import pkgutil
import re
import sys
from collections.abc import Callable, Iterator
from hashlib import blake2b
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from gamekeeper import import_guard
from gamekeeper.errors import SpecError
from gamekeeper.interface.construction import (
    VERSION,
    did_you_mean,
    foreign,
    modules_called,
    nearest,
)
from gamekeeper.interface.env_source import NotHereError
from gamekeeper.interface.object_source import FILE_MODULE

_FILE_FORM: Final = re.compile(r"(.+?\.py)(?::([^:/\\]+))?", re.DOTALL)


def split_file(text: str) -> tuple[str, str | None] | None:
    """Path and name of `path/to/file.py:name`, the name perhaps absent; None for another form."""
    form = _FILE_FORM.fullmatch(text)
    return (form[1], form[2]) if form else None


def load_module(name: str, *, pip: str = "") -> ModuleType:
    """The module called `name`, imported; the current folder is looked in after everything else.

    Args:
        pip: what to install where importing it needs a package that isn't there.
    Raises:
        NotHereError: it, or a package that it stands in, doesn't exist.
        SpecError: it exists, and importing it raised.
    """
    try:
        with current_folder_last(), foreign(f"importing {name}", where=name, pip=pip):
            return imported(name)
    except SpecError as error:
        cause = error.__cause__
        missing = (cause.name or "") if isinstance(cause, ModuleNotFoundError) else ""
        if missing and f"{name}.".startswith(f"{missing}."):
            raise _no_module(missing, name) from None
        raise


def imported(name: str) -> ModuleType:
    """The module called `name`, also where a package only offers it: `from package import module`.

    A package may name a module that lies elsewhere, or load it when it is asked for; no import
    statement finds such a module by its dotted name.

    Raises:
        ModuleNotFoundError: it doesn't exist, and no package has a module under that name.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package, _, part = name.rpartition(".")
        if not package or not f"{name}.".startswith(f"{error.name}."):
            raise
        offered = getattr(imported(package), part, None)
        if not isinstance(offered, ModuleType):
            raise
        return offered


def file_module(path: Path, source: bytes) -> str:
    """Name under which a file is loaded.

    It holds the digest of the very bytes that run: an edited file is another module, an unchanged
    one is the same, with the same classes.
    """
    digest = blake2b(str(path).encode(errors="surrogateescape") + b"\0" + source, digest_size=6)
    stem = re.sub(r"\W", "_", path.stem)
    return f"{FILE_MODULE}{stem}_{digest.hexdigest()}"


def load_file(typed: str) -> tuple[ModuleType, Path]:
    """The module that a file makes, and the file: loaded once, and again only after it was edited.

    Its folder stands first on `sys.path` meanwhile, so that modules beside it can be imported;
    these are ordinary modules, and stay as they were first imported.

    Raises:
        NotHereError: there is no such file.
        SpecError: it can't be read, or running it raised.
    """
    path = _existing(typed)
    try:
        source = path.read_bytes()
    except OSError as error:
        raise SpecError(
            f"{typed} can't be read",
            where=typed,
            actual=str(error),
            fix="check the path, and that the file may be read",
        ) from error
    name = file_module(path, source)
    guard = import_guard.active()
    if guard is not None and guard.modules and name not in guard.modules:
        raise SpecError(
            f"{typed} isn't one of the files that the run was recorded with",
            where=str(path),
            fix="if you trust it, allow it (--allow-import)",
        )
    if name not in sys.modules:
        _run(source, path, name, typed)
    return sys.modules[name], path


def _run(source: bytes, path: Path, name: str, typed: str) -> None:
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None  # a path that ends in .py always has a loader
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    try:
        with foreign(f"loading {typed}", where=typed), first_on_path(path.parent):
            # Not through the loader: that would write __pycache__ beside the user's file.
            exec(compile(source, str(path), "exec", dont_inherit=True), vars(module))
    except BaseException:
        sys.modules.pop(name, None)
        raise


def within(
    folder: Callable[[], contextlib.AbstractContextManager[None]], call: Callable[..., object]
) -> Callable[..., object]:
    """The same callable, run with a folder on `sys.path` for what it imports only then."""

    @functools.wraps(call, updated=())
    def call_within(**kwargs: Any) -> object:
        with folder():
            return call(**kwargs)

    return call_within


@contextlib.contextmanager
def first_on_path(folder: Path) -> Iterator[None]:
    """The folder stands first on `sys.path`, as that of a script does, where no guard closes it."""
    entry = str(folder)
    if not _is_open(entry):
        yield
        return
    sys.path.insert(0, entry)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):  # foreign code may have removed it
            sys.path.remove(entry)


@contextlib.contextmanager
def current_folder_last() -> Iterator[None]:
    """The current folder stands on `sys.path`, where no guard closes it.

    A console script lacks it, unlike `python -m`.
    """
    folder = str(Path.cwd())
    is_added = "" not in sys.path and folder not in sys.path and _is_open(folder)
    if is_added:
        sys.path.append(folder)
    try:
        yield
    finally:
        if is_added:
            with contextlib.suppress(ValueError):
                sys.path.remove(folder)


def _is_open(folder: str) -> bool:
    guard = import_guard.active()
    return guard is None or guard.allows(folder)


def _existing(typed: str) -> Path:
    path = Path(typed)
    try:
        path = path.expanduser().resolve()
        if path.is_file():
            return path
        there = [other.name for other in path.parent.glob("*.py")] if path.parent.is_dir() else []
        actual = "a folder" if path.is_dir() else f"nothing there{nearest(path.name, there)}"
        absent = next((p for p in reversed(path.parents) if not p.is_dir()), None)
        if absent is not None:
            actual = f"there is no folder {absent}"
    except (OSError, ValueError, RuntimeError) as error:  # too long, a null byte, no home folder
        actual = str(error)
    raise NotHereError(
        f"there is no file {typed}",
        where=typed,
        expected=f"a Python file at {path}",
        actual=actual,
        fix="give the path from the current folder, or from the root",
    )


def _no_module(missing: str, name: str) -> NotHereError:
    parent, _, part = missing.rpartition(".")
    meant = modules_called(parent, VERSION.sub("", part))
    if parent:
        package = sys.modules.get(parent)
        there = [info.name for info in pkgutil.iter_modules(getattr(package, "__path__", []))]
        actual = f"'{parent}' has no module '{part}'{nearest(part, there)}"
        close = difflib.get_close_matches(part, there, n=1, cutoff=0.8)
        meant = meant or [f"{parent}:{part}"] * hasattr(package, part)
        meant = meant or [f"{parent}.{each}" for each in close]
    else:
        tops = importlib.metadata.packages_distributions()
        actual = f"no module '{part}' is installed or in the current folder{nearest(part, tops)}"
    return NotHereError(
        f"there is no module {name}",
        where=name,
        expected="a module that can be imported",
        actual=actual,
        fix=did_you_mean(meant) or "install the package that holds it, or start where it lies",
    )
