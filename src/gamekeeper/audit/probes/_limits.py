"""Numbers that an environment holds under names that sound like a limit of time."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from types import FunctionType, MethodType, ModuleType
from typing import Any, Final

from gymnasium.spaces import Space

LIMIT: Final = re.compile(
    r"(^|_)(max|limit|horizon|cutoff|timeout|deadline|closing|duration|(n|num)_(steps|cycles|ticks))"
    r"(_|$)",
    re.IGNORECASE,
)
"""How people call a limit of time."""
NO_LIMIT: Final = re.compile(
    r"round|turn|move|hand|card|score|point|size|width|height|agent|player|speed|reward|health",
    re.IGNORECASE,
)
"""Of these a game's own rules may have a last one, or they are no time."""
LIMITS: Final = range(5, 1_000_000)
_NO_SETTINGS: Final = (type, ModuleType, FunctionType, MethodType, Space)


def limits_of(env: Any) -> dict[str, int]:
    """Such numbers by name; the nearer one where two have the same name.

    They are looked for in the instance, in what it holds (a dictionary or an object of settings),
    in its classes, in its constructors' defaults and in the modules that the classes stand in.
    """
    inner = getattr(env, "unwrapped", env)
    own = dict(getattr(inner, "__dict__", {}))
    found: dict[str, int] = {}
    for named in (own, *map(_settings, own.values()), *_of_classes(type(inner))):
        for name, value in named.items():
            if _is_limit(name, value):
                found.setdefault(name, value)
    return found


def _is_limit(name: object, value: object) -> bool:
    return (
        type(value) is int
        and value in LIMITS
        and isinstance(name, str)
        and LIMIT.search(name) is not None
        and NO_LIMIT.search(name) is None
    )


def _settings(value: Any) -> Mapping[Any, Any]:
    """What stands in a dictionary or an object."""
    if isinstance(value, dict):
        return value
    held = None if isinstance(value, _NO_SETTINGS) else getattr(value, "__dict__", None)
    return held if isinstance(held, dict) else {}


def _of_classes(kind: type) -> Iterator[Mapping[Any, Any]]:
    for each in kind.__mro__:
        if each.__module__.partition(".")[0] in sys.stdlib_module_names:
            continue  # Python's own limits are no environment's
        yield vars(each)
        yield _defaults(vars(each).get("__init__"))
        yield getattr(sys.modules.get(each.__module__), "__dict__", {})


def _defaults(function: Any) -> Mapping[str, Any]:
    """The defaults of a constructor's parameters."""
    try:
        parameters = inspect.signature(function).parameters
    except (TypeError, ValueError):  # none of Python's, or none of its own
        return {}
    return {name: each.default for name, each in parameters.items()}
