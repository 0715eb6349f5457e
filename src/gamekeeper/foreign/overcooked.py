"""`overcooked:cramped_room`: a layout of Overcooked, for its number of cooks."""

from typing import Any, Final

from gamekeeper.foreign.marlenv import MarlEnv
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source

WORD: Final = "overcooked"
SYNTAX: Final = "overcooked:cramped_room"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = foreign_openers.distrust_packages(WORD)


def locate(spec: str, api: str | None) -> Source:
    """The environment of a layout; arguments are those of `Overcooked.from_layout`."""
    layout = foreign_openers.rest(spec, WORD) or ""
    overcooked = foreign_openers.need(WORD)

    def build(**kwargs: Any) -> MarlEnv:
        return MarlEnv(overcooked.Overcooked.from_layout(layout, **kwargs), name=layout)

    return foreign_openers.source(WORD, layout, build)
