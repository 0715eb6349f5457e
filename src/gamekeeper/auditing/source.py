"""Source of an environment's rules: the class, its file and its line."""

import inspect
import sys
import sysconfig
from collections.abc import Collection, Mapping
from typing import Any, Final

from gamekeeper.interface.identity import class_of
from gamekeeper.interface.object_source import class_name

THREADED: Final = frozenset({"jax", "jaxlib", "ray", "tensorflow"})
"""Packages that start threads once they are imported: a fork has none of them, and may wait."""


def source_of(env: Any) -> dict[str, Any]:
    """The class that holds the rules, with `file` and `line` where it was read from a file.

    Of an environment of another shape it is the guest's own class.
    """
    kind = class_of(env)
    found: dict[str, Any] = {"class": class_name(kind)}
    try:
        found["file"] = inspect.getsourcefile(kind)
        found["line"] = inspect.getsourcelines(kind)[1]
    except (TypeError, OSError, IndexError):  # typed at a prompt, compiled, or edited meanwhile
        pass
    return {name: value for name, value in found.items() if value is not None}


def place_of(source: Mapping[str, Any]) -> str:
    """File and line of `source_of`, as compilers write them; empty where they aren't known."""
    file, line = source.get("file"), source.get("line")
    return f"{file}:{line}" if file and line else str(file or "")


def own_packages(env: Any) -> frozenset[str]:
    """Names of the packages of an environment's classes, those of what it wraps included."""
    classes = (*type(env).__mro__, *class_of(env).__mro__)
    return frozenset(cls.__module__.partition(".")[0] for cls in classes)


def installed_modules(env: Any, before: Collection[str]) -> tuple[str, ...]:
    """Modules of installed packages that came with an environment, but for its own package's."""
    own = own_packages(env)
    folders = tuple(sysconfig.get_paths()[name] for name in ("purelib", "platlib"))
    found = []
    for name, module in list(sys.modules.items()):
        spec = getattr(module, "__spec__", None)
        if spec is None or spec.name != name or name in before:
            continue
        if str(spec.origin).startswith(folders):
            found.append(name)
    return tuple(n for n in found if n.partition(".")[0] not in own | THREADED)
