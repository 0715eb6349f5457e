"""`path/to/file.py:factory`: a Python file that no package holds."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import re
import sys
from collections.abc import Callable, Iterator
from hashlib import blake2b
from os import PathLike, fspath
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.construct import foreign, nearest
from gamekeeper.game.factory import find_factory
from gamekeeper.game.opened import NotHereError, Source

SYNTAX: Final = "path/to/file.py:factory"
ORDER: Final = 20

_FORM: Final = re.compile(r"(?P<path>.+\.py)(?::(?P<name>[^:/\\]+))?", re.DOTALL)
_MODULE_PREFIX: Final = "_gamekeeper_file_"


def matches(spec: object) -> bool:
    """Whether it is a path that ends in `.py`, with or without `:factory`."""
    return isinstance(spec, str | PathLike) and _FORM.fullmatch(_text(spec)) is not None


def locate(spec: str | PathLike[str], api: str | None) -> Source:
    """The factory in the file. The file is loaded once, and again only after it was edited.

    Its folder stands first on `sys.path` while the file is loaded and while an instance is built,
    so that modules beside it can be imported; these are ordinary modules, and stay as they were
    first imported.
    """
    form = _FORM.fullmatch(_text(spec))
    assert form is not None  # matches() came first
    typed, name = form["path"], form["name"]
    path = _existing(typed)
    module = _load(path, typed)
    found = find_factory(module, name, api, where=typed)
    return Source(
        kind="file",
        factory=found.factory if found.is_single else _beside(path.parent, found.factory),
        spec=f"{Path(typed).as_posix()}:{found.name}",
        entry_point=f"{path.name}:{found.name}",
        is_single=found.is_single,
        facts={"path": path.as_posix()},
    )


def distrust(spec: str) -> str | None:
    """Always: anything may stand in a file."""
    return f"{spec} is a file outside the installed packages"


def _text(spec: str | PathLike[str]) -> str:
    return str(fspath(spec))


def _existing(typed: str) -> Path:
    try:
        path = Path(typed).expanduser().resolve()
        if path.is_file():
            return path
        there = [other.name for other in path.parent.glob("*.py")] if path.parent.is_dir() else []
        seen = "a folder" if path.is_dir() else f"nothing there{nearest(path.name, there)}"
        missing_folder = next((p for p in reversed(path.parents) if not p.is_dir()), None)
        if missing_folder is not None:
            seen = f"there is no folder {missing_folder}"
    except (OSError, ValueError, RuntimeError) as error:  # too long, a null byte, no home folder
        seen = str(error)
        path = Path(typed)
    raise NotHereError(
        f"there is no file {typed}",
        where=typed,
        expected=f"a Python file at {path}",
        seen=seen,
        mend="give the path from the current folder, or from the root",
    )


def _load(path: Path, typed: str) -> ModuleType:
    try:
        source = path.read_bytes()
    except OSError as error:
        raise SpecError(f"{typed} can't be read", where=typed, seen=str(error)) from error
    # What names the module is what it says: the digest of the very bytes that run. An edited file
    # is another module, an unchanged one is the same, with the same classes.
    digest = blake2b(str(path).encode(errors="surrogateescape") + b"\0" + source, digest_size=6)
    stem = re.sub(r"\W", "_", path.stem)
    name = f"{_MODULE_PREFIX}{stem}_{digest.hexdigest()}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None  # a path that ends in .py always has a loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        with foreign(f"loading {typed}", where=typed), _first_on_path(path.parent):
            # Not through the loader: that would write __pycache__ beside the user's file.
            exec(compile(source, str(path), "exec", dont_inherit=True), vars(module))
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _beside(folder: Path, factory: Callable[..., object]) -> Callable[..., object]:
    @functools.wraps(factory, updated=())
    def build_beside(**kwargs: Any) -> object:
        with _first_on_path(folder):
            return factory(**kwargs)

    return build_beside


@contextlib.contextmanager
def _first_on_path(folder: Path) -> Iterator[None]:
    entry = str(folder)
    sys.path.insert(0, entry)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):  # foreign code may have removed it
            sys.path.remove(entry)
