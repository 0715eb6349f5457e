"""`marlenv:module:factory`: an environment of the package `marlenv`, such as LLE."""

from __future__ import annotations

from typing import Final

from gamekeeper.game.openers import _family, _shaped
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.marlenv import MarlEnv

WORD: Final = "marlenv"
SYNTAX: Final = "marlenv:path/to/file.py:factory"
ORDER: Final = _family.ORDER

NAMES: Final = ("n_agents", "observation_shape", "available_actions", "reset", "step")


def matches(spec: object) -> bool:
    """Whether it begins with `marlenv:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The factory of a module or file."""
    text = _family.rest(spec, WORD) or ""
    return _shaped.source_of_shape(text, word=WORD, family="marlenv", names=NAMES, wrap=MarlEnv)


def distrust(spec: str) -> str | None:
    """What is said of any file, and of any module that a text names."""
    return _shaped.distrust_text(_family.rest(spec, WORD) or "")
