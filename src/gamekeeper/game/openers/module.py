"""`module:factory`: an importable module, installed or in the current folder."""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.metadata
import importlib.util
import pkgutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.construct import foreign, nearest
from gamekeeper.game.factory import find_factory
from gamekeeper.game.installed import distrust_module
from gamekeeper.game.opened import NotHereError, Source

SYNTAX: Final = "module:factory"
ORDER: Final = 90


def matches(spec: object) -> bool:
    """Whether it is a dotted name, with or without `:factory`."""
    if not isinstance(spec, str):
        return False
    module, colon, name = spec.partition(":")
    parts = module.split(".") + (name.split(".") if colon else [])
    return all(part.isidentifier() for part in parts) and not module.endswith(".py")


def locate(spec: str, api: str | None) -> Source:
    """The factory in the module; the current folder is looked in too, after everything else."""
    name, _, factory = spec.partition(":")
    with _current_folder_last():
        module = load_module(name)
        found = find_factory(module, factory or None, api, where=name)
    return Source(
        kind="module",
        factory=found.factory if found.is_single else _in_current_folder(found.factory),
        spec=f"{name}:{found.name}",
        entry_point=f"{name}:{found.name}",
        is_single=found.is_single,
    )


def distrust(spec: str) -> str | None:
    """Why the module isn't known to hold environments: not installed, or no such name in it."""
    name, _, factory = spec.partition(":")
    return distrust_module(name, factory)


def load_module(name: str, *, pip: str = "") -> ModuleType:
    """The module called `name`, imported.

    Raises:
        NotHereError: it, or a package that it stands in, doesn't exist.
        SpecError: it exists, and importing it raised.
    """
    try:
        with foreign(f"importing {name}", where=name, pip=pip):
            return importlib.import_module(name)
    except SpecError as error:
        cause = error.__cause__
        if isinstance(cause, ModuleNotFoundError) and _is_prefix(cause.name or "", name):
            raise _not_there(cause.name or name, name) from None
        raise


def _is_prefix(missing: str, name: str) -> bool:
    return name == missing or name.startswith(missing + ".")


def _not_there(missing: str, name: str) -> NotHereError:
    parent, _, part = missing.rpartition(".")
    if parent:
        package = sys.modules.get(parent)
        there = [info.name for info in pkgutil.iter_modules(getattr(package, "__path__", []))]
        seen = f"'{parent}' has no module '{part}'{nearest(part, there)}"
    else:
        tops = importlib.metadata.packages_distributions()
        seen = f"no module '{part}' is installed or in the current folder{nearest(part, tops)}"
    return NotHereError(
        f"there is no module {name}",
        where=name,
        expected="a module that can be imported",
        seen=seen,
        mend="install the package that holds it, or start where it lies",
    )


def _in_current_folder(factory: Callable[..., object]) -> Callable[..., object]:
    @functools.wraps(factory, updated=())
    def build_in_current_folder(**kwargs: Any) -> object:
        with _current_folder_last():
            return factory(**kwargs)

    return build_in_current_folder


@contextlib.contextmanager
def _current_folder_last() -> Iterator[None]:
    # A console script, other than `python -m`, doesn't have it on its path at all.
    folder = str(Path.cwd())
    if "" in sys.path or folder in sys.path:
        yield
        return
    sys.path.append(folder)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            sys.path.remove(folder)
