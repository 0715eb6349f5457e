"""`marlenv:module:factory`: an environment of the package `marlenv`, such as LLE."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.openers import _family
from gamekeeper.game.opening.installed import distrust_module
from gamekeeper.game.opening.load import split_file
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.marlenv import MarlEnv

WORD: Final = "marlenv"
SYNTAX: Final = "marlenv:path/to/file.py:factory"
ORDER: Final = _family.ORDER

METHODS: Final = ("n_agents", "observation_shape", "available_actions", "reset", "step")


def matches(spec: object) -> bool:
    """Whether it begins with `marlenv:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The factory of a module or file."""
    text = _family.rest(spec, WORD) or ""
    factory, module, facts = _family.factory_named(text)

    def build(**kwargs: Any) -> MarlEnv:
        env = factory(**kwargs)
        lacks = [name for name in METHODS if not hasattr(env, name)]
        if lacks:
            raise SpecError(
                f"{text} built something that isn't of marlenv's shape",
                where=text,
                expected=", ".join(METHODS),
                seen=f"{type(env).__qualname__} without {', '.join(lacks)}",
            )
        return MarlEnv(env, name=text.rpartition(":")[2])

    return Source(
        kind=WORD,
        factory=build,
        spec=f"{WORD}:{text}",
        entry_point=f"{WORD}:{text}",
        accepts=factory,
        pip=f"pip install {module.partition('.')[0]}",
        facts=facts,
    )


def distrust(spec: str) -> str | None:
    """What is said of any file, and of any module that a text names."""
    text = _family.rest(spec, WORD) or ""
    if split_file(text) is not None:
        return f"{text} is a file outside the installed packages"
    return distrust_module(text.partition(":")[0], "env")
