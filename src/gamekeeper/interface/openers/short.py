"""`warehouse`: one of our own environments, in its newest version unless one is named."""

import re
from typing import Final

from gamekeeper.interface import registry
from gamekeeper.interface.env_source import Source

SYNTAX: Final = "warehouse"
ORDER: Final = 40

_FORM: Final = re.compile(r"\w+(-v\d+)?")


def matches(spec: object) -> bool:
    """Tells whether it is a single word, with a version or without."""
    return isinstance(spec, str) and bool(_FORM.fullmatch(spec))


def locate(spec: str, api: str | None) -> Source:
    """The factory registered as `gamekeeper/<name>`, or else under the name alone."""
    broken = registry.with_ours()
    name = registry.canonical(spec)
    for env_id in (f"{registry.OURS}/{name}", name):
        known = registry.newest(env_id)
        if known is not None:
            return registry.source_of(known, api)
    raise registry.unknown(f"{registry.OURS}/{name}", broken)


def distrust(spec: str) -> str | None:
    """Never: only code that runs already can put an id into the registries."""
    return None
