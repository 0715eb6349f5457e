"""`overcooked:cramped_room`: a layout of Overcooked's, for as many cooks as it has."""

from typing import Any, Final

from gamekeeper.foreign.marlenv import MarlEnv
from gamekeeper.interface import named
from gamekeeper.interface.env_source import Source

WORD: Final = "overcooked"
SYNTAX: Final = "overcooked:cramped_room"
ORDER: Final = named.ORDER
matches: Final = named.begins_with(WORD)
distrust: Final = named.distrust_packages(WORD)


def locate(spec: str, api: str | None) -> Source:
    """The environment of a layout; arguments are those of `Overcooked.from_layout`."""
    layout = named.rest(spec, WORD) or ""
    overcooked = named.need(WORD)

    def build(**kwargs: Any) -> MarlEnv:
        return MarlEnv(overcooked.Overcooked.from_layout(layout, **kwargs), name=layout)

    return named.source(WORD, layout, build)
