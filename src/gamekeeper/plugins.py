"""What extends Gamekeeper: built-ins by walking a package, third parties by entry points."""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import sys
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType

Installed = tuple[tuple[str, int], ...]
"""The places that modules come from, each with the time of its last change in nanoseconds."""


@dataclass(frozen=True, slots=True)
class BrokenPlugin:
    """A third party's plug-in that is left out, and why; it stops nobody else."""

    name: str
    group: str
    origin: str
    """The distribution it comes from and the object it names: `farm-envs 1.2 (farm.opener)`."""
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


def load(group: str, package: str | None = None) -> Plugins:
    """Every module of a built-in package, and what entry points of a group name.

    A built-in is a module, under the last part of its name; modules whose name starts with an
    underscore are none. An entry point's object is whatever it names. What it prints goes to
    stderr. A third party can't take the name of a built-in, nor one that another distribution has
    taken already.

    Args:
        group: the group of entry points, such as `gamekeeper.openers`.
        package: the package with the built-ins, such as `gamekeeper.game.openers`; None: there are
            none.

    Raises:
        ImportError: a built-in can't be imported; that is a fault of this installation, so it is
            not hidden.
    """
    found: dict[str, object] = {}
    broken: list[BrokenPlugin] = []
    for name in [] if package is None else _modules(package):
        found[name] = importlib.import_module(f"{package}.{name}")
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
            broken.append(_broken(entry, _said(error), "".join(traceback.format_exception(error))))
    return Plugins(MappingProxyType(found), tuple(broken))


def one(group: str, name: str) -> object | None:
    """What an entry point of this name is, of the first distribution by its value; None: nobody's.

    Nothing else of the group is loaded.
    """
    entries = (entry for entry in _entries(group, installed()) if entry.name == name)
    first = next(entries, None)
    return None if first is None else first.load()


def installed() -> Installed:
    """What stands for everything installed: another value once something came, changed or went.

    What is read of distributions is kept for one such value, as reading all of them takes 5 ms and
    more, which is what opening a small environment takes otherwise.
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


def _modules(package: str) -> list[str]:
    names = [info.name for info in pkgutil.iter_modules(importlib.import_module(package).__path__)]
    return sorted(name for name in names if not name.startswith("_"))


def _broken(entry: EntryPoint, error: str, trace: str = "") -> BrokenPlugin:
    owner = f"{entry.dist.name} {entry.dist.version}" if entry.dist else "an unknown distribution"
    return BrokenPlugin(entry.name, entry.group, f"{owner} ({entry.value})", error, trace)


def _said(error: BaseException) -> str:
    # The text of a foreign exception may itself raise; traceback copes with that.
    return "".join(traceback.format_exception_only(error)).strip()
