"""Plug-ins: built-ins by walking a package, third parties' by entry points."""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import sys
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

Part = TypeVar("Part")
Installed = tuple[tuple[str, int], ...]
"""The places of modules, each with the time of its last change in nanoseconds."""


@dataclass(frozen=True, slots=True)
class BrokenPlugin:
    """A third party's plug-in that is left out, with the reason; the others still load."""

    name: str
    group: str
    origin: str
    """Its distribution and the object that it names: `farm-envs 1.2 (farm.opener)`."""
    error: str
    traceback: str = ""

    def __str__(self) -> str:
        """One line for a list or a warning."""
        return f"{self.group}: {self.name} of {self.origin} is left out: {self.error}"


@dataclass(frozen=True, slots=True)
class Plugins:
    """The plug-ins of one group: built-ins by name, then third parties' by name."""

    found: Mapping[str, object]
    broken: tuple[BrokenPlugin, ...] = ()

    def parts(self, kind: type[Part]) -> Iterator[tuple[str, Part]]:
        """Every object of a class that a plug-in is, or holds as a module, with its name."""
        for origin, part in self.found.items():
            own = [part] if isinstance(part, kind) else getattr(part, "__dict__", {}).values()
            yield from ((origin, each) for each in own if isinstance(each, kind))


def load(group: str, *packages: str) -> Plugins:
    """Every module of the built-in packages, and what entry points of a group name.

    A built-in is a module, under the last part of its name; modules whose name starts with an
    underscore are none. An entry point's object is whatever it names. What it prints goes to
    stderr. A third party can't take the name of a built-in, nor one that another distribution has
    taken already.

    Args:
        group: the group of entry points, such as `gamekeeper.openers`.
        *packages: those with the built-ins, such as `gamekeeper.checks`, and packages in them.

    Raises:
        ImportError: a built-in can't be imported; that is a fault of this installation, so it is
            not hidden.
    """
    found: dict[str, object] = {}
    broken: list[BrokenPlugin] = []
    for package in packages:
        for name in modules(package):
            found[name.rpartition(".")[2]] = importlib.import_module(f"{package}.{name}")
    for entry in _entries(group, installed()):
        if entry.name in found:
            broken.append(_broken(entry, "its name is taken; names need their own prefix"))
            continue
        try:
            with contextlib.redirect_stdout(sys.stderr):
                found[entry.name] = entry.load()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # also SystemExit: foreign code, run only to look at it
            broken.append(_broken(entry, _text(error), "".join(traceback.format_exception(error))))
    return Plugins(MappingProxyType(found), tuple(broken))


def one(group: str, name: str) -> object | None:
    """Loads the entry point of this name, the first by its value; None: there is none.

    Nothing else of the group is loaded.
    """
    entries = (entry for entry in _entries(group, installed()) if entry.name == name)
    first = next(entries, None)
    return None if first is None else first.load()


def names(group: str) -> frozenset[str]:
    """The names of a group's entry points; nothing of it is loaded."""
    return frozenset(entry.name for entry in _entries(group, installed()))


def installed() -> Installed:
    """A value that changes once a package is installed, changed or removed.

    Entry points are cached by this value, as reading those of all distributions takes 5 ms and
    more, about as long as opening a small environment.
    """
    return tuple((place, _changed_ns(place)) for place in sys.path)


def _changed_ns(place: str) -> int:
    try:
        return Path(place).stat().st_mtime_ns
    except (OSError, ValueError):  # also a current folder that was deleted: it holds nothing
        return -1


@lru_cache(maxsize=32)
def _entries(group: str, there: Installed) -> tuple[EntryPoint, ...]:
    found = entry_points(group=group)
    return tuple(sorted(found, key=lambda entry: (entry.name, entry.value)))


def modules(package: str) -> list[str]:
    """Names of a package's plug-ins, dotted below it: modules without a leading underscore."""
    infos = list(pkgutil.iter_modules(importlib.import_module(package).__path__))
    public = [info for info in infos if not info.name.startswith("_")]
    names = [info.name for info in public if not info.ispkg]
    for folder in [info.name for info in public if info.ispkg]:
        names += [f"{folder}.{name}" for name in modules(f"{package}.{folder}")]
    return sorted(names)


def _broken(entry: EntryPoint, error: str, traceback: str = "") -> BrokenPlugin:
    owner = f"{entry.dist.name} {entry.dist.version}" if entry.dist else "an unknown distribution"
    return BrokenPlugin(entry.name, entry.group, f"{owner} ({entry.value})", error, traceback)


def _text(error: BaseException) -> str:
    # The text of a foreign exception may itself raise; traceback copes with that.
    return "".join(traceback.format_exception_only(error)).strip()
