"""Which callable of a module builds its environment, when its user names one and when not."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Final

from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import SpecError
from gamekeeper.game.opening.construct import foreign, nearest
from gamekeeper.game.opening.opened import api_of

FACTORY_NAMES: Final = {
    None: ("parallel_env", "env", "make", "raw_env"),
    "parallel": ("parallel_env", "make", "env", "raw_env"),
    "aec": ("env", "make", "raw_env", "parallel_env"),
}
"""Names tried in order where none is given, by the API asked for."""

_MISSING: Final = object()


@dataclass(frozen=True, slots=True)
class Found:
    """A factory and its name in its module; `is_single` where that is an environment already."""

    name: str
    factory: Callable[..., object]
    is_single: bool = False


def find_factory(module: ModuleType, name: str | None, api: str | None, *, where: str) -> Found:
    """The factory called `name`; without a name the usual names, then the only environment class.

    Args:
        module: the module, loaded.
        name: dotted name inside it, or None.
        api: `aec` or `parallel` where the user asked for one.
        where: the module or file as it was typed, for messages.

    Raises:
        SpecError: there is no such name, it can't be called, or there is none or more than one to
            choose.
    """
    if name is not None:
        return _named(module, name, where)
    for usual in FACTORY_NAMES[api]:
        value = _get(module, usual, where)
        # A submodule called env, or an instance made to try things out, is no factory.
        if callable(value) and api_of(value) is None and not _is_imported(value, usual, module):
            return Found(usual, value)
    return _only_class(module, api, where)


def _named(module: ModuleType, name: str, where: str) -> Found:
    value: object = module
    for part in name.split("."):
        holder, value = value, _get(value, part, where)
        if value is _MISSING:
            public = [other for other in dir(holder) if not other.startswith("_")]
            raise SpecError(
                f"{where} has nothing called '{name}'{nearest(part, public)}",
                where=f"{where}:{name}",
                expected="the name of a function or class that builds the environment",
                seen=f"there are {_some(_builders(module))}",
            )
    if api_of(value) is not None:
        instance = value
        return Found(name, lambda: instance, is_single=True)
    if not callable(value):
        raise SpecError(
            f"{where}:{name} can't be called",
            where=f"{where}:{name}",
            expected="a function or class that builds the environment",
            seen=f"{type(value).__qualname__}",
        )
    return Found(name, value)


def _only_class(module: ModuleType, api: str | None, where: str) -> Found:
    classes = _env_classes(module)
    leaves = {
        name: found
        for name, found in classes.items()
        if not any(other is not found and issubclass(other, found) for other in classes.values())
    }
    wanted = {"aec": AECEnv, "parallel": ParallelEnv}
    if api is not None and len(leaves) > 1:
        leaves = {name: kind for name, kind in leaves.items() if issubclass(kind, wanted[api])}
    if len(leaves) == 1:
        name, found = leaves.popitem()
        return Found(name, found)
    tried = ", ".join(FACTORY_NAMES[None])
    raise SpecError(
        f"{where} doesn't say which environment is meant"
        if leaves or classes
        else f"{where} has no environment that can be found without its name",
        where=where,
        expected=f"one of {tried}, or exactly one class derived from AECEnv or ParallelEnv",
        seen=_some([f"{where}:{name}" for name in (leaves or classes)] or _builders(module)),
        mend=f"name the factory: {where}:NAME",
    )


def _is_imported(value: object, name: str, module: ModuleType) -> bool:
    """Whether another package offers this under this very name: `from gymnasium import make`."""
    home = (getattr(value, "__module__", None) or "").partition(".")[0]
    is_own = home == module.__name__.partition(".")[0]
    return not is_own and getattr(sys.modules.get(home), name, None) is value


def _env_classes(module: ModuleType) -> dict[str, type]:
    # A package may define its class in a part of itself and only name it again at the top.
    own = (module.__name__, module.__name__ + ".")
    return {
        name: value
        for name, value in sorted(vars(module).items())
        if inspect.isclass(value)
        and issubclass(value, AECEnv | ParallelEnv)
        and not name.startswith("_")
        and (value.__module__ == own[0] or value.__module__.startswith(own[1]))
    }


def _builders(module: ModuleType) -> list[str]:
    public = {
        name: value
        for name, value in sorted(vars(module).items())
        if not name.startswith("_") and (inspect.isfunction(value) or inspect.isclass(value))
    }
    own = [name for name, value in public.items() if value.__module__ == module.__name__]
    return own or list(public)


def _get(holder: object, name: str, where: str) -> object:
    # A module's own __getattr__ may import, warn or raise anything.
    with foreign(f"looking up '{name}' in {where}", where=where):
        return getattr(holder, name, _MISSING)


def _some(names: list[str], *, most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) + more) if names else "none"
