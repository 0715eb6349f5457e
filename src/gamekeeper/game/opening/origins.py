"""What environments were made from, as long as they live: a recorded object is reopened by it."""

from __future__ import annotations

import weakref
from typing import Any, Final

# The one state of this room. Keyed by id, because an environment may define equality; an entry goes
# with its environment.
_ORIGINS: Final[dict[int, dict[str, Any]]] = {}


def remember(env: object, identity: dict[str, Any]) -> None:
    """Notes the identity that `env` was opened under; one that can't be referred to isn't noted."""
    try:
        weakref.finalize(env, _ORIGINS.pop, id(env), None).atexit = False
    except TypeError:  # a class with slots and no place for a reference
        return
    _ORIGINS[id(env)] = identity


def origin_of(env: object) -> dict[str, Any] | None:
    """The identity that `env` was opened under by `gk.make`, or None."""
    return _ORIGINS.get(id(env))
