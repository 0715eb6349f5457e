"""`butterfly/pistonball-v6`: what `pettingzoo.make` knows."""

import re
from typing import Final

from gamekeeper.interface import registry
from gamekeeper.interface.env_source import Source

SYNTAX: Final = "butterfly/pistonball-v6"
ORDER: Final = 30

_FORM: Final = re.compile(r"[\w.-]+/[\w.-]+")


def matches(spec: object) -> bool:
    """Tells whether it is `namespace/name`, with a version or without."""
    return isinstance(spec, str) and not spec.endswith(".py") and bool(_FORM.fullmatch(spec))


def locate(spec: str, api: str | None) -> Source:
    """The factory registered under the id; without a version, under its highest."""
    broken = registry.with_ours()
    env_id = registry.newest(registry.canonical(spec))
    if env_id is None:
        raise registry.unknown(registry.canonical(spec), broken)
    return registry.source_of(env_id, api)


def distrust(spec: str) -> str | None:
    """Never: only code that runs already can put an id into the registries."""
    return None
