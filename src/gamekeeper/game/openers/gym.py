"""`gym:module:factory`: an environment of the old OpenAI Gym's shape, registered or not."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.openers import _family, _packages, _shaped
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.old_gym import OldGym

WORD: Final = "gym"
SYNTAX: Final = "gym:module:factory, or gym:module:Id-v0"
ORDER: Final = _family.ORDER


def matches(spec: object) -> bool:
    """Whether it begins with `gym:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The factory of a module or file, or what the old Gym's registry has under an id."""
    text = _family.rest(spec, WORD) or ""
    found = _family.ID.fullmatch(text)
    if found is not None:
        return _registered(found["module"], found["id"], text)
    factory, module, facts = _family.factory_named(text)
    return _source(text, factory, pip=module, accepts=factory, facts=facts)


def distrust(spec: str) -> str | None:
    """What is said of any file, and of any module that a text names."""
    return _shaped.distrust_text(_family.rest(spec, WORD) or "")


def _registered(module: str | None, env_id: str, text: str) -> Source:
    gym = _packages.need("gym")
    if module is not None:
        _packages.need(module, here=True)
    registry = gym.envs.registration.registry
    known = sorted(getattr(registry, "env_specs", registry))
    if env_id not in known:
        raise _family.unknown(env_id, "the old Gym", known)
    make = functools.partial(gym.make, env_id)
    if "disable_env_checker" in gym.make.__code__.co_varnames:
        # Gym 0.26 checks with names that NumPy 2 no longer has.
        make = functools.partial(make, disable_env_checker=True)
    home = module or "gym"
    return _source(text, make, pip=home, facts=_packages.package_fact(home))


def _source(
    text: str,
    factory: Callable[..., Any],
    *,
    pip: str,
    accepts: Callable[..., Any] | None = None,
    facts: dict[str, str],
) -> Source:
    def build(**kwargs: Any) -> OldGym:
        env = factory(**kwargs)
        lacks = [
            name for name in ("reset", "step", "action_space", "observation_space")
            if not hasattr(env, name)
        ]  # fmt: skip
        if lacks:
            raise SpecError(
                f"{text} built something that isn't of the old Gym's shape",
                where=text,
                expected="reset, step, action_space and observation_space",
                seen=f"{type(env).__qualname__} without {', '.join(lacks)}",
            )
        return OldGym(env, name=text.rpartition(":")[2])

    return Source(
        kind=WORD,
        factory=build,
        spec=f"{WORD}:{text}",
        entry_point=f"{WORD}:{text}",
        accepts=accepts,
        pip=f"pip install {pip.partition('.')[0]}",
        facts=facts,
    )
