"""Openers that begin with a word: `gymnasium:`, `jaxmarl:`, `openspiel:`."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Callable
from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.openers import _packages
from gamekeeper.game.opening.construct import nearest
from gamekeeper.game.opening.factory import find_factory
from gamekeeper.game.opening.load import current_folder_last, load_file, split_file, within

ORDER: Final = 45
"""Words are read before `module:factory`, which has the same form."""
ID: Final = re.compile(r"(?:(?P<module>[A-Za-z_][\w.]*):)?(?P<id>(?:[\w.-]+/)?[\w.-]*-v\d+)")
"""An id of Gymnasium's, with the module in front that registers it."""


def rest(spec: object, word: str) -> str | None:
    """What stands behind `word:`; None where something else stands in front."""
    if not isinstance(spec, str):
        return None
    before, colon, after = spec.partition(":")
    return after.strip() if colon and before == word and after.strip() else None


def words() -> frozenset[str]:
    """The words of all families, as their openers declare them in `WORD`."""
    package = importlib.import_module("gamekeeper.game.openers")
    names = [info.name for info in pkgutil.iter_modules(package.__path__)]
    modules = [importlib.import_module(f"{package.__name__}.{name}") for name in names]
    return frozenset(module.WORD for module in modules if hasattr(module, "WORD"))


def factory_named(text: str) -> tuple[Callable[..., Any], str, dict[str, str]]:
    """The callable under `module:name` or `path/to/file.py:name`, its module, facts about it.

    Raises:
        DependencyError: the module's package isn't installed.
        SpecError: there is no such file or name.
    """
    file = split_file(text)
    if file is not None:
        module, path = load_file(file[0])
        found = find_factory(module, file[1] or "make", None, where=file[0])
        return found.factory, module.__name__, {"path": path.as_posix()}
    name, colon, factory = text.partition(":")
    if not colon or not factory:
        raise SpecError(
            "a factory has no name",
            where=text,
            expected="module:factory, or path/to/file.py:factory",
            seen=text,
        )
    found = find_factory(_packages.need(name, here=True), factory, None, where=name)
    return within(current_folder_last, found.factory), name, _packages.package_fact(name)


def unknown(name: str, family: str, known: list[str]) -> SpecError:
    """The error for a name that a family hasn't got, with what comes near it."""
    close = nearest(name, known)
    return SpecError(
        f"{family} has no environment called {name}",
        where=name,
        expected=f"one of {len(known)} names",
        seen=f"nothing there{close}" if close else ", ".join(sorted(known)[:12]),
    )
