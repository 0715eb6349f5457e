"""A callable that builds the environment: a function, a class, a partial."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Final

from gamekeeper.interface.env_source import Source, api_of
from gamekeeper.interface.modules import FILE_MODULE

SYNTAX: Final = "a factory callable"
ORDER: Final = 10


def matches(spec: object) -> bool:
    """Tells whether it can be called and is no environment itself."""
    return callable(spec) and api_of(spec) is None


def locate(spec: Callable[..., object], api: str | None) -> Source:
    """A source of kind `module` where it can be imported by its name, of kind `factory` else."""
    name = getattr(spec, "__qualname__", "") or getattr(type(spec), "__qualname__", "")
    entry_point = f"{getattr(spec, '__module__', None) or '?'}:{name}"
    if _is_importable(spec, entry_point):
        return Source(kind="module", factory=spec, spec=entry_point, entry_point=entry_point)
    return Source(
        kind="factory", factory=spec, spec=f"<factory {entry_point}>", entry_point=entry_point
    )


def distrust(spec: object) -> str | None:
    """Always: a text can't name a callable of another process."""
    return "it was recorded from a factory in memory, which no text can find again"


def _is_importable(spec: object, entry_point: str) -> bool:
    # A script's own functions aren't: importing the script again would run it again, rollouts and
    # all.
    module, _, name = entry_point.partition(":")
    if module == "__main__" or module.startswith(FILE_MODULE):
        return False
    value: object = sys.modules.get(module)
    for part in name.split("."):
        value = getattr(value, part, None)
    return value is spec
