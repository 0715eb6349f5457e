"""Probe of the options of resets: those that a reset asks for, and what is left of them."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.probes.seed_episodes import OTHERWISE
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.process_randomness import held

MOST_OPTIONS: Final = 6
TURNS: Final = 60
SMALL: Final = 2
"""A whole number in place of one that is twice as large, or larger."""
_UNKNOWN: Final = object()


class AskedOptions(dict[Any, Any]):
    """Options that note the keys they are asked for, each with the default that was given."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: dict[Any, Any] = {}

    def __bool__(self) -> bool:
        return True

    def __contains__(self, key: object) -> bool:
        self.asked.setdefault(key, _UNKNOWN)
        return False

    def __missing__(self, key: Any) -> Any:
        self.asked.setdefault(key, _UNKNOWN)
        raise KeyError(key)

    def get(self, key: Any, default: Any = None) -> Any:
        """Notes the key, and gives the default."""
        if default is not None or key not in self.asked:
            self.asked[key] = _UNKNOWN if default is None else default
        return default

    def pop(self, key: Any, *default: Any) -> Any:
        """Notes the key, and gives the default."""
        self.get(key, *default)
        return default[0] if default else self.__missing__(key)


@probe("options", share=0.0, on_top=0.05, plays=lambda session: session.plays(1, most_turns=TURNS))
def options(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """A reset with another value of an option, then a reset without options.

    The value is another one of the same type as the default, or as the attribute of that name.

    Counterfactuals by `change`: `options before`, an episode after a reset with that option, beside
    one after a reset without; `the same option`, an episode with it played again, with the global
    generators elsewhere.
    """
    asked, env = AskedOptions(), session.env()
    with held():
        session.call("reset", env.reset, seed=play.seed, options=asked)
    if not asked.asked:
        return
    base = session.fresh(play)
    before = replace(base.play, actions=(), most_turns=0)
    plain, again = (session.after(before, base.play) for _ in range(2))
    for key, default in list(asked.asked.items())[:MOST_OPTIONS]:
        for value in _others(_standing(env, key) if default is _UNKNOWN else default):
            first = session.fresh(replace(base.play, options={key: value}))
            if first.failed is not None and first.failed.call == "reset":
                continue
            if session.divergence(base.episode, first.episode) is None:
                continue
            named = {"option": key, "value": value}
            after = session.after(replace(before, options={key: value}), base.play)
            change = {"change": "options before", **named}
            yield session.beside(plain.episode, again.episode, after.episode, change)
            with held(OTHERWISE):
                same = session.play(first.play, session.env(), hold=False)
            change = {"change": "the same option", **named}
            yield session.beside(first.episode, first.episode, same.episode, change)
            break


def _standing(env: Any, key: Any) -> Any:
    """Value of the attribute that is called like an option; None without one."""
    bare = getattr(env, "unwrapped", env)
    names = (str(key), f"_{key}")
    return next((vars(bare)[name] for name in names if name in getattr(bare, "__dict__", {})), None)


def _others(value: Any) -> list[Any]:
    """Other values of the same type."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        small = [SMALL] if value > 2 * SMALL else []  # a limit that this episode meets
        return (
            [value + 1, value - 1, 2 * value + 1, *small] if value > 1 else [value + 1, value + 2]
        )
    if isinstance(value, float):
        return [2 * value + 0.5, value / 2]
    return []
