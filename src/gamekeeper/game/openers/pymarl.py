"""`pymarl:module:factory`: an environment of PyMARL's shape, as SMAC and SMACv2 have it."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.openers import _family
from gamekeeper.game.opening.installed import distrust_module
from gamekeeper.game.opening.load import split_file
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.pymarl import PyMarl

WORD: Final = "pymarl"
SYNTAX: Final = "pymarl:smacv2.env:StarCraft2Env"
ORDER: Final = _family.ORDER

METHODS: Final = ("get_env_info", "get_obs", "get_avail_actions", "reset", "step")


def matches(spec: object) -> bool:
    """Whether it begins with `pymarl:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The factory of a module or file."""
    text = _family.rest(spec, WORD) or ""
    factory, module, facts = _family.factory_named(text)

    def build(**kwargs: Any) -> PyMarl:
        env = factory(**kwargs)
        lacks = [name for name in METHODS if not callable(getattr(env, name, None))]
        if lacks:
            raise SpecError(
                f"{text} built something that isn't of PyMARL's shape",
                where=text,
                expected=", ".join(METHODS),
                seen=f"{type(env).__qualname__} without {', '.join(lacks)}",
            )
        return PyMarl(env, name=text.rpartition(":")[2])

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
