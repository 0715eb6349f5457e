"""`rware:rware-tiny-2ag-v2`: a Gymnasium id behind its module, as `gymnasium.make` reads it."""

from __future__ import annotations

from typing import Final

from gamekeeper.game.openers import _family
from gamekeeper.game.openers.gymnasium import source_of_id
from gamekeeper.game.opening.installed import distrust_module
from gamekeeper.game.opening.opened import Source

SYNTAX: Final = "rware:rware-tiny-2ag-v2"
ORDER: Final = 80


def matches(spec: object) -> bool:
    """Whether it is `module:Id-v0`, and the module isn't the word of another opener."""
    found = _family.ID.fullmatch(spec) if isinstance(spec, str) else None
    return found is not None and bool(found["module"]) and found["module"] not in _family.words()


def locate(spec: str, api: str | None) -> Source:
    """The environment that is registered once the module was imported."""
    module, _, env_id = spec.partition(":")
    return source_of_id(module, env_id, spec)


def distrust(spec: str) -> str | None:
    """What is said of any module that a text names."""
    return distrust_module(spec.partition(":")[0], "env")
