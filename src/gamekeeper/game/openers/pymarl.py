"""`pymarl:module:factory`: an environment of PyMARL's shape, as SMAC and SMACv2 have it."""

from __future__ import annotations

from typing import Final

from gamekeeper.game.openers import _family, _shaped
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.pymarl import PyMarl

WORD: Final = "pymarl"
SYNTAX: Final = "pymarl:smacv2.env:StarCraft2Env"
ORDER: Final = _family.ORDER

NAMES: Final = ("get_env_info", "get_obs", "get_avail_actions", "reset", "step")


def matches(spec: object) -> bool:
    """Whether it begins with `pymarl:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The factory of a module or file."""
    text = _family.rest(spec, WORD) or ""
    return _shaped.source_of_shape(text, word=WORD, family="PyMARL", names=NAMES, wrap=PyMarl)


def distrust(spec: str) -> str | None:
    """What is said of any file, and of any module that a text names."""
    return _shaped.distrust_text(_family.rest(spec, WORD) or "")
