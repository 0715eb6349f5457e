"""`butterfly/pistonball-v6`: what `pettingzoo.make` knows."""

from __future__ import annotations

import re
from typing import Final

from gamekeeper.game.openers import _registry
from gamekeeper.game.opening.opened import Source

SYNTAX: Final = "butterfly/pistonball-v6"
ORDER: Final = 30

_FORM: Final = re.compile(r"[\w.-]+/[\w.-]+")


def matches(spec: object) -> bool:
    """Whether it is `namespace/name`, with a version or without."""
    return isinstance(spec, str) and not spec.endswith(".py") and bool(_FORM.fullmatch(spec))


def locate(spec: str, api: str | None) -> Source:
    """The factory registered under the id; without a version, under its highest."""
    broken = _registry.with_ours()
    env_id = _registry.newest(_registry.canonical(spec))
    if env_id is None:
        raise _registry.unknown(_registry.canonical(spec), broken)
    return _registry.source_of(env_id, api)


def distrust(spec: str) -> str | None:
    """Never: only code that runs already can put an id into the registries."""
    return None
