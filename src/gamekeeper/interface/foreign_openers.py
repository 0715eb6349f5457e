"""Openers that begin with a word: `gymnasium:`, `jaxmarl:`, `openspiel:`."""

import importlib
import importlib.util
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from gamekeeper import plugins
from gamekeeper.errors import DependencyError, SpecError
from gamekeeper.interface.construction import find_factory, nearest
from gamekeeper.interface.distributions import owner_of
from gamekeeper.interface.env_source import NotHereError, Source
from gamekeeper.interface.modules import (
    current_folder_last,
    load_file,
    load_module,
    split_file,
    within,
)

PIP: Final = {"gym": "gym==0.26.2", "pyspiel": "shimmy open-spiel", "shimmy": "shimmy open-spiel"}
"""Packages that provide a module of another name."""


def need(module: str, *, pip: str = "", here: bool = False) -> ModuleType:
    """A module of a foreign package, imported.

    Args:
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
            raise SpecError(
                absent.what, where=module, actual=absent.actual, fix=absent.fix
            ) from None
        raise _missing(top, line) from None


def _missing(top: str, line: str) -> DependencyError:
    return DependencyError(
        f"the package of the module '{top}' isn't installed",
        where=top,
        expected=f"an importable module '{top}'",
        actual="none",
        fix=line,
    )


def package_fact(module: str) -> dict[str, str]:
    """The distribution of a module with its version, as an entry of an identity; none, no entry."""
    owner = owner_of(module.partition(".")[0])
    return {} if owner is None else {"package": f"{owner.name} {owner.version}"}


def distrust_package(module: str) -> str | None:
    """Reason why evidence from elsewhere may not have a module imported; None if installed.

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


FOREIGN: Final = "gamekeeper.foreign"
"""The package of these openers; named as text, as it stands above this one."""
ORDER: Final = 45
"""Words are read before `module:factory`, which has the same form."""
ID: Final = re.compile(r"(?:(?P<module>[A-Za-z_][\w.]*):)?(?P<id>(?:[\w.-]+/)?[\w.-]*-v\d+)")
"""An id of Gymnasium's, with the module in front that registers it."""


def rest(spec: object, word: str) -> str | None:
    """Text behind `word:`; None where it begins otherwise."""
    if not isinstance(spec, str):
        return None
    before, colon, after = spec.partition(":")
    return after.strip() if colon and before == word and after.strip() else None


def begins_with(word: str) -> Callable[[object], bool]:
    """`matches` of an opener: tells whether a spec begins with `word:`."""
    return lambda spec: rest(spec, word) is not None


def distrust_packages(*modules: str) -> Callable[[str], str | None]:
    """`distrust` of an opener whose names run no code but that of these packages."""
    return lambda spec: next(filter(None, map(distrust_package, modules)), None)


def words() -> frozenset[str]:
    """The words of all families, as their openers declare them in `WORD`."""
    names = plugins.modules(FOREIGN)
    modules = [importlib.import_module(f"{FOREIGN}.{name}") for name in names]
    return frozenset(module.WORD for module in modules if hasattr(module, "WORD"))


def source(
    word: str,
    name: str,
    factory: Callable[..., object],
    *,
    pip: str = "",
    facts: Mapping[str, str] | None = None,
    default_api: str | None = None,
    accepts: Callable[..., object] | None = None,
) -> Source:
    """The source of `word:name`, from the package of that word unless others are named.

    Args:
        pip: what to install.
        facts: of the module that it comes from.
    """
    text = f"{word}:{name}"
    return Source(
        kind=word,
        factory=factory,
        spec=text,
        entry_point=text,
        default_api=default_api,
        accepts=accepts,
        pip=f"pip install {pip or word}",
        facts=package_fact(word) if facts is None else facts,
    )


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
            actual=text,
            fix="put the factory's name behind the colon",
        )
    found = find_factory(need(name, here=True), factory, None, where=name)
    return within(current_folder_last, found.factory), name, package_fact(name)


def unknown(name: str, family: str, known: list[str]) -> SpecError:
    """The error for a name that a family hasn't got, with what comes near it."""
    close = nearest(name, known)
    return SpecError(
        f"{family} has no environment called {name}",
        where=name,
        expected=f"one of {len(known)} names",
        actual=f"nothing there{close}" if close else ", ".join(sorted(known)[:12]),
        fix="use one of these names, or install the version that has it",
    )
