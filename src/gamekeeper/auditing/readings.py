"""Readings: environments of another form than the API's, read so that the audit can go on.

What is wrong with the form is told by probes that see the environment as it is; all others play it
through its readings, which also stand at the head of their reproducers.
"""

import copy
import inspect
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import accumulate
from typing import Any, Final

from gymnasium.spaces import Space

from gamekeeper.auditing.holds import Hold, with_methods
from gamekeeper.interface.opening import Opened
from gamekeeper.rollouts.process_randomness import held

AS_IT_IS: Final = frozenset({"metadata", "spaces", "surface"})
"""Probes that look at the form itself."""


def spaces_read(make: Callable[[], Any]) -> Callable[[], Any]:
    """Gives the spaces that an environment keeps as attributes, where a call gives none."""

    def asked(name: str, env: Any, own: Any) -> Callable[[Any], Any]:
        def ask(agent: Any) -> Any:
            if hasattr(own, "contains"):  # a space in place of a method
                return own
            try:
                space = own(agent)
            except Exception:
                space = None
            for attribute in (f"{name}s", f"_{name}s"):
                kept = getattr(env, attribute, None)
                if not hasattr(space, "contains") and isinstance(kept, dict) and agent in kept:
                    space = kept[agent]
            return own(agent) if space is None else space

        return ask

    def both_ways(name: str, env: Any, own: Any) -> Any:
        class Both:
            __call__ = staticmethod(asked(name, env, own))

            def __getattr__(self, attribute: str) -> Any:  # the environment itself reads those
                return getattr(own, attribute)

        return Both()

    def methods(cls: Any) -> dict[str, Any]:
        def read(name: str) -> Any:
            def get(self: Any) -> Any:
                own = vars(self).get(name)
                if own is None:
                    found = inspect.getattr_static(cls, name)
                    own = found.__get__(self, cls) if hasattr(found, "__get__") else found
                return both_ways(name, self, own)

            def put(self: Any, value: Any) -> None:
                vars(self)[name] = value

            return property(get, put)

        return {name: read(name) for name in ("observation_space", "action_space")}

    return with_methods(make, methods)


def returns_read(make: Callable[[], Any]) -> Callable[[], Any]:
    """Reads observations without infos as both, and three or four values of a step as five."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def flags(agents: Any, part: Any) -> dict[Any, Any]:
            known = part if isinstance(part, dict) else {}
            return {agent: known.get(agent, known.get("__all__", False)) for agent in agents}

        def infos(agents: Any, part: Any) -> dict[Any, Any]:
            known = part if isinstance(part, dict) else {}
            return {a: known[a] if isinstance(known.get(a), dict) else {} for a in agents}

        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            out = cls.reset(self, *args, **kwargs)
            observations, last = out if isinstance(out, tuple) and len(out) == 2 else (out, {})
            return observations, infos(self.agents, last)

        def step(self: Any, actions: Any) -> Any:
            before = list(self.agents)
            out = cls.step(self, actions)
            if not isinstance(out, tuple) or len(out) not in (3, 4):
                return out
            agents = dict.fromkeys((*before, *self.agents))
            last = out[3] if len(out) == 4 and isinstance(out[3], dict) else {}
            are_infos = all(isinstance(each, dict) for each in last.values())
            truncations = flags(agents, {} if are_infos else last)
            return *out[:2], flags(agents, out[2]), truncations, infos(agents, last)

        return {"reset": reset, "step": step}

    return with_methods(make, methods)


SPACES: Final = Hold("spaces read where the environment keeps them", spaces_read)
RETURNS: Final = Hold("what reset and step return read as the API has it", returns_read)
FORMS: Final = {"aec": ((), (SPACES,)), "parallel": ((), (SPACES,), (RETURNS,), (SPACES, RETURNS))}
"""Readings to choose from, by API, the fewest first."""


def readings_of(opened: Opened, seed: int) -> tuple[Hold, ...]:
    """The fewest readings by which most can be seen of a reset and a step; none where none helps.

    An instance is built, reset and stepped for each.
    """
    if opened.make is None:
        return ()
    scores = [_seen(through(opened.make, each), opened.api, seed) for each in FORMS[opened.api]]
    return FORMS[opened.api][scores.index(max(scores))]


def through(make: Callable[[], Any], readings: tuple[Hold, ...]) -> Callable[[], Any]:
    """Builds the environment, to be read so."""
    *_, built = accumulate(readings, lambda below, each: each.function(below), initial=make)
    return built


def _seen(make: Callable[[], Any], api: str, seed: int) -> int:
    """Number of things that have the API's form: both spaces, what reset and what step returns."""
    found = 0
    with held(), suppress(Exception, SystemExit):
        env = make()
        try:
            out = env.reset(seed=seed)
            agents = list(env.agents)
            found += api == "aec" or _are_dictionaries(out, 2)
            seen, done = (_spaces(x, agents) for x in (env.observation_space, env.action_space))
            found += seen is not None
            if done is not None:
                found += 1
                if api == "parallel":
                    out = env.step({agent: space.sample() for agent, space in done.items()})
                    found += _are_dictionaries(out, 5)
        finally:
            env.close()
    return found


def _spaces(ask: Callable[[Any], Any], agents: list[Any]) -> dict[Any, Any] | None:
    """Seeded copies of the agents' spaces; None where one has none."""
    with suppress(Exception):
        spaces = {agent: copy.deepcopy(ask(agent)) for agent in agents}
        if all(isinstance(each, Space) for each in spaces.values()):
            for each in spaces.values():
                each.seed(0)
            return spaces
    return None


def _are_dictionaries(out: Any, count: int) -> bool:
    """Tells whether so many dictionaries were returned, the first of them with entries."""
    if not isinstance(out, tuple | list) or len(out) != count:
        return False
    return bool(out[0]) and all(isinstance(part, Mapping) for part in out)
