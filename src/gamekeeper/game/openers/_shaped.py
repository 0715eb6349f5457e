"""Openers of factories whose environments have another package's shape: PyMARL, marlenv, Gym."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from gamekeeper.errors import SpecError
from gamekeeper.game.openers import _family
from gamekeeper.game.opening.installed import distrust_module
from gamekeeper.game.opening.load import split_file
from gamekeeper.game.opening.opened import Source


def source_of_shape(
    text: str, *, word: str, family: str, names: Sequence[str], wrap: Callable[..., Any]
) -> Source:
    """The factory of a module or file; what it builds is checked for the shape and wrapped.

    Args:
        text: `module:factory` or `path/to/file.py:factory`.
        word: what stands before it in the spec.
        family: whose shape it is, for errors.
        names: attributes that an environment of the shape has.
        wrap: makes a PettingZoo environment of one; takes it and its `name`.
    """
    factory, module, facts = _family.factory_named(text)

    def build(**kwargs: Any) -> Any:
        env = factory(**kwargs)
        lacks = [name for name in names if not hasattr(env, name)]
        if lacks:
            raise SpecError(
                f"{text} built something that isn't of {family}'s shape",
                where=text,
                expected=", ".join(names),
                seen=f"{type(env).__qualname__} without {', '.join(lacks)}",
            )
        return wrap(env, name=text.rpartition(":")[2])

    return Source(
        kind=word,
        factory=build,
        spec=f"{word}:{text}",
        entry_point=f"{word}:{text}",
        accepts=factory,
        pip=f"pip install {module.partition('.')[0]}",
        facts=facts,
    )


def distrust_text(text: str) -> str | None:
    """What is said of any file, and of any module that a text names."""
    if split_file(text) is not None:
        return f"{text} is a file outside the installed packages"
    return distrust_module(text.partition(":")[0], "env")
