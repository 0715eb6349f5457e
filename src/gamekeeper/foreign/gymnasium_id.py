"""`rware:rware-tiny-2ag-v2`: a Gymnasium id behind its module, as `gymnasium.make` reads it."""

from typing import Final

from gamekeeper.foreign.gymnasium import source_of_id
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.distributions import distrust_module
from gamekeeper.interface.env_source import Source

SYNTAX: Final = "rware:rware-tiny-2ag-v2"
ORDER: Final = 80


def matches(spec: object) -> bool:
    """Tells whether it is `module:Id-v0`, and the module isn't the word of another opener."""
    found = foreign_openers.ID.fullmatch(spec) if isinstance(spec, str) else None
    return (
        found is not None
        and bool(found["module"])
        and found["module"] not in foreign_openers.words()
    )


def locate(spec: str, api: str | None) -> Source:
    """The environment that is registered once the module was imported."""
    module, _, env_id = spec.partition(":")
    return source_of_id(module, env_id, spec)


def distrust(spec: str) -> str | None:
    """Reason for consent: a module that a text names may run any code."""
    return distrust_module(spec.partition(":")[0], "env")
