"""Foreign packages as openers need them: loaded, named with their version, vouched for."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Final

from gamekeeper.errors import DependencyError, SpecError
from gamekeeper.game.opening.installed import owner_of
from gamekeeper.game.opening.load import load_module
from gamekeeper.game.opening.opened import NotHereError

PIP: Final = {"gym": "gym==0.26.2", "pyspiel": "shimmy open-spiel", "shimmy": "shimmy open-spiel"}
"""What provides a module that is called otherwise."""


def need(module: str, *, pip: str = "", here: bool = False) -> ModuleType:
    """A module of a foreign package, imported.

    Args:
        module: dotted name.
        pip: what to install; without it, as the module is called.
        here: also a module of the current folder will do.
    Raises:
        DependencyError: the package isn't installed.
        SpecError: it is, and importing it raised.
    """
    top = module.partition(".")[0]
    line = f"pip install {pip or PIP.get(top, top)}"
    if importlib.util.find_spec(top) is None and not here:
        raise _missing(top, line)
    try:
        return load_module(module, pip=line)
    except NotHereError as absent:
        if importlib.util.find_spec(top) is not None:
            raise SpecError(absent.what, where=module, seen=absent.seen) from None
        raise _missing(top, line) from None


def _missing(top: str, line: str) -> DependencyError:
    return DependencyError(
        f"the package of the module '{top}' isn't installed",
        where=top,
        expected=f"an importable module '{top}'",
        seen="none",
        mend=line,
    )


def package_fact(module: str) -> dict[str, str]:
    """The distribution of a module with its version, as an entry of an identity; none, no entry."""
    owner = owner_of(module.partition(".")[0])
    return {} if owner is None else {"package": f"{owner.name} {owner.version}"}


def distrust_package(module: str) -> str | None:
    """Why evidence from elsewhere may not have a module imported; None where it is installed.

    For modules that an opener names itself. What a text names is for `distrust_module`.
    """
    top = module.partition(".")[0]
    owner = owner_of(top)
    if owner is None:
        return f"the module {top} belongs to no installed distribution"
    home = Path(str(owner.locate_file(""))).resolve()
    found = importlib.util.find_spec(top)
    origin = None if found is None or found.origin is None else Path(found.origin).resolve()
    # A namesake in a folder full of evidence would be imported in place of the installed one.
    if origin is None or home == Path.cwd() or not origin.is_relative_to(home):
        return f"the module {top} isn't the one that {owner.name} installed"
    return None
