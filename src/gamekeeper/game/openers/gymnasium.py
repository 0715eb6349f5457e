"""`gymnasium:CartPole-v1`: an environment of Gymnasium's, of one agent or of several in tuples."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Final

import gymnasium

from gamekeeper.errors import SpecError
from gamekeeper.game.openers import _family, _packages
from gamekeeper.game.opening.installed import distrust_module
from gamekeeper.game.opening.load import split_file
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.gymnasium import guest_of

WORD: Final = "gymnasium"
SYNTAX: Final = "gymnasium:CartPole-v1, or gymnasium:module:factory"
ORDER: Final = 5
"""Before callables: a Gymnasium environment may be one."""


def matches(spec: object) -> bool:
    """Whether it begins with `gymnasium:`, or is a Gymnasium environment already."""
    return isinstance(spec, gymnasium.Env) or _family.rest(spec, WORD) is not None


def locate(spec: Any, api: str | None) -> Source:
    """The registered environment, the factory of a module or file, or the object itself."""
    if isinstance(spec, gymnasium.Env):
        return _of_object(spec)
    text = _family.rest(spec, WORD) or ""
    found = _family.ID.fullmatch(text)
    if found is not None:
        return source_of_id(found["module"], found["id"], f"{WORD}:{text}")
    if ":" in text or split_file(text) is not None:
        factory, module, facts = _family.factory_named(text)
        return Source(
            kind=WORD,
            factory=functools.wraps(factory, updated=())(_hosted(factory, text)),
            spec=f"{WORD}:{text}",
            entry_point=f"{WORD}:{text}",
            accepts=factory,
            pip=f"pip install {module.partition('.')[0]}",
            facts=facts,
        )
    raise _family.unknown(text, "Gymnasium", sorted(gymnasium.registry))


def distrust(spec: object) -> str | None:
    """None for an id that is registered already; of a module what is said of any module."""
    if isinstance(spec, gymnasium.Env):
        return "it was recorded from an object in memory, which no text can build again"
    text = _family.rest(spec, WORD) or ""
    found = _family.ID.fullmatch(text)
    if found is not None and found["module"] is None:
        return None if found["id"] in gymnasium.registry else f"{text} isn't registered"
    if found is None and split_file(text) is not None:
        return f"{text} is a file outside the installed packages"
    return distrust_module(text.partition(":")[0], "env")


def source_of_id(module: str | None, env_id: str, shown: str) -> Source:
    """The source of an id, after the module was imported that registers it.

    Raises:
        DependencyError: the module's package isn't installed.
        SpecError: nothing is registered under the id.
    """
    if module is not None:
        _packages.need(module, here=True)
    try:
        entry = gymnasium.spec(env_id)
    except gymnasium.error.Error as error:
        missing = _family.unknown(env_id, "Gymnasium", sorted(gymnasium.registry))
        raise SpecError(
            missing.what, where=shown, expected=missing.expected, seen=f"{error}; {missing.seen}",
            mend="name the module that registers it: gymnasium:module:Id-v0",
        ) from None  # fmt: skip
    point = entry.entry_point
    home = point.partition(":")[0] if isinstance(point, str) else getattr(point, "__module__", "")
    # The checker of Gymnasium's own raises for tuples of rewards; the audit looks at more.
    make = functools.partial(gymnasium.make, env_id, disable_env_checker=True)
    return Source(
        kind=WORD,
        factory=_hosted(make, env_id),
        spec=shown,
        entry_point=shown,
        pip=f"pip install {(module or home).partition('.')[0]}",
        facts=_packages.package_fact(module or home),
    )


def _hosted(make: Callable[..., Any], name: str) -> Callable[..., object]:
    def build(**kwargs: Any) -> object:
        env = make(**kwargs)
        if not isinstance(env, gymnasium.Env):
            raise SpecError(
                f"{name} built something that is no Gymnasium environment",
                where=name,
                expected="a gymnasium.Env",
                seen=f"{type(env).__module__}.{type(env).__qualname__}",
                mend="an environment of the old Gym's shape opens as gym:...",
            )
        return guest_of(env, name=name.rpartition(":")[2])

    return build


def _of_object(env: Any) -> Source:
    kind = type(env.unwrapped)
    name = f"{kind.__module__}:{kind.__qualname__}"
    known = getattr(env.spec, "id", None) or kind.__qualname__
    guest = guest_of(env, name=known)
    return Source(
        kind="object",
        factory=lambda: guest,
        spec=f"<object of {name}>",
        entry_point=name,
        accepts=kind,
        is_single=True,
        facts=_packages.package_fact(kind.__module__),
    )
