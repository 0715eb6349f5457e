"""`overcooked:cramped_room`: a layout of Overcooked's, for as many cooks as it has."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.game.openers import _family, _packages
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.marlenv import MarlEnv

WORD: Final = "overcooked"
SYNTAX: Final = "overcooked:cramped_room"
ORDER: Final = _family.ORDER


def matches(spec: object) -> bool:
    """Whether it begins with `overcooked:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The environment of a layout; arguments are those of `Overcooked.from_layout`."""
    layout = _family.rest(spec, WORD) or ""
    overcooked = _packages.need(WORD)

    def build(**kwargs: Any) -> MarlEnv:
        return MarlEnv(overcooked.Overcooked.from_layout(layout, **kwargs), name=layout)

    return Source(
        kind=WORD,
        factory=build,
        spec=f"{WORD}:{layout}",
        entry_point=f"{WORD}:{layout}",
        pip=f"pip install {WORD}",
        facts=_packages.package_fact(WORD),
    )


def distrust(spec: str) -> str | None:
    """Why the package isn't the installed one; a layout is but a name."""
    return _packages.distrust_package(WORD)
