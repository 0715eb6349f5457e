"""Openers of factories whose environments have another package's shape: PyMARL, marlenv, Gym."""

from collections.abc import Callable, Sequence
from typing import Any

from gamekeeper.errors import SpecError
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.distributions import distrust_module
from gamekeeper.interface.env_source import Source
from gamekeeper.interface.modules import split_file


def source_of_shape(
    text: str,
    *,
    word: str,
    family: str,
    names: Sequence[str],
    wrap: Callable[..., Any],
    registered: tuple[Callable[..., Any], str] | None = None,
) -> Source:
    """The factory of a module or file; what it builds is checked for the shape and wrapped.

    Args:
        text: `module:factory` or `path/to/file.py:factory`.
        word: what stands before it in the spec.
        family: whose shape it is, for errors.
        names: attributes that an environment of the shape has.
        wrap: makes a PettingZoo environment of one; takes it and its `name`.
        registered: the factory and its module, where the text is an id of a registry.
    """
    if registered is None:
        factory, module, facts = foreign_openers.factory_named(text)
    else:
        factory, module = registered
        facts = foreign_openers.package_fact(module)

    def build(**kwargs: Any) -> Any:
        env = factory(**kwargs)
        lacks = [name for name in names if not hasattr(env, name)]
        if lacks:
            raise SpecError(
                f"{text} built something that isn't of {family}'s shape",
                where=text,
                expected=", ".join(names),
                actual=f"{type(env).__qualname__} without {', '.join(lacks)}",
                fix="name a factory of such an environment, or use the prefix of its own library",
            )
        return wrap(env, name=text.rpartition(":")[2])

    accepts = factory if registered is None else None
    pip = module.partition(".")[0]
    return foreign_openers.source(word, text, build, accepts=accepts, pip=pip, facts=facts)


def distrust_named(word: str) -> Callable[[str], str | None]:
    """`distrust` of an opener behind whose word a file or a module stands: it may run any code."""

    def distrust(spec: str) -> str | None:
        text = foreign_openers.rest(spec, word) or ""
        if split_file(text) is not None:
            return f"{text} is a file outside the installed packages"
        return distrust_module(text.partition(":")[0], "env")

    return distrust
