"""`gym:module:factory`: an environment of the old OpenAI Gym's shape, registered or not."""

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, MultiBinary, MultiDiscrete

from gamekeeper.foreign import _shaped
from gamekeeper.foreign._guest import (
    ForeignEnv,
    ForeignStep,
    Given,
    dealt,
    flags,
    infos,
    limit_of,
    numbered,
    rewards,
    wrong_shape,
)
from gamekeeper.foreign._spaces import as_gymnasium, idle, several
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source
from gamekeeper.interface.old_gym import TRUNCATED

EACH: Final = "truncated"
"""Key by which our own environments, in this shape, say truncation of each agent."""
SEEDS: Final = 2**32
"""Old environments hand their seed to numpy.random.seed, which takes no more."""


class OldGym(ForeignEnv):
    """An environment of the old Gym's shape, of one agent or of several in lists.

    | | kept | changed |
    |---|---|---|
    | observations | arrays | lists of numbers become arrays of their space's dtype |
    | rewards | one of each agent; one alone is paid to all in full | |
    | done | terminated | truncated where the info has a true `TimeLimit.truncated` (or a list |
    | | | `truncated`, of each agent), and where all |
    | | | end in the tick of the environment's own limit ("time limit") |
    | info | as in Gymnasium's shape; `{"n": [...]}` is one of each agent | beside `n`, what tells |
    | | | of truncation stands in the flags alone |
    | seeds | the low 32 bits go to `env.seed()` before the reset | |
    | options | | refused: its reset takes none |
    | who has ended | | no action is asked of it; the list still has one, of its space's zero |
    """

    optionless = "the old Gym"
    unknown: tuple[str, ...] = (
        "whether an end was a rule's or a limit's, where neither the info nor a limit tells",
        "whether env.seed() reaches all of its randomness",
        "whether the environment looks at the action of an agent that has ended",
    )

    def __init__(self, env: Any, *, name: str) -> None:
        super().__init__(env, name=name)
        acting, seeing = several(env.action_space), several(env.observation_space)
        self._is_list = acting is not None and (seeing is None or len(seeing) == len(acting))
        if acting is None or not self._is_list:
            acting, seeing = [as_gymnasium(env.action_space)], None
        if seeing is None:  # one space, which all of them share
            seeing = [as_gymnasium(env.observation_space)] * len(acting)
        limit = limit_of(getattr(env, "unwrapped", env))
        self._settle(numbered(len(acting)), seeing, acting, limit=limit)
        self._idle = {agent: idle(space) for agent, space in self.action_spaces.items()}
        self._takes_seed = "seed" in _parameters(env.reset)

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        out: Any = None
        if self._takes_seed:  # Gym 0.26, the last of the old, has the new reset
            out = self.guest.reset(seed=None if seed is None else seed % SEEDS)
        else:
            if seed is not None and callable(getattr(self.guest, "seed", None)):
                self.guest.seed(seed % SEEDS)
            out = self.guest.reset()
        info: Any = {}
        if self._takes_seed and isinstance(out, tuple) and len(out) == 2:
            out, info = out
        return self._dealt(out), self._infos(info)

    def _play(self, actions: Given) -> ForeignStep:
        agents = self.possible_agents
        chosen = [{**self._idle, **actions}[agent] for agent in agents]
        out = self.guest.step(chosen if self._is_list else chosen[0])
        if not isinstance(out, tuple) or len(out) not in (4, 5):
            raise wrong_shape("step", expected="four values, or Gymnasium's five", actual=out)
        observations, paid, done, info = out[0], out[1], out[2], out[-1]
        ended = flags(done, agents, "done")
        shared = info if isinstance(info, Mapping) else {}
        said = out[3] if len(out) == 5 else _said(shared, len(agents))
        cut = flags(said, agents, "truncated")
        if len(out) == 4:  # done holds for both kinds of end, and the info tells which it was
            cut = {agent: cut[agent] and ended[agent] for agent in agents}
            ended = {agent: ended[agent] and not cut[agent] for agent in agents}
        return ForeignStep(
            self._dealt(observations), rewards(paid, agents), ended, cut, self._infos(info)
        )

    def _dealt(self, observations: Any) -> Given:
        values = observations if self._is_list else [observations]
        seen = dealt(values, self.possible_agents, "observations")
        return {
            agent: _array(value, self.observation_spaces[agent]) for agent, value in seen.items()
        }

    def _infos(self, info: Any) -> dict[str, dict[str, Any]]:
        agents = self.possible_agents
        each = info.get("n") if isinstance(info, Mapping) else None
        if isinstance(each, Sequence) and len(each) == len(agents):
            flagged = {"n", EACH, TRUNCATED}  # these stand in the flags now
            common = {key: value for key, value in info.items() if key not in flagged}
            return {agent: {**common, **own} for agent, own in infos(each, agents).items()}
        return infos(info, agents)


def _said(info: Mapping[str, Any], count: int) -> Any:
    """Truncation by an info: of each agent where it says so, else of the episode."""
    each = info.get(EACH)
    is_each = isinstance(each, list | tuple) and len(each) == count
    return each if is_each else info.get(TRUNCATED, False)


def _array(value: Any, space: Any) -> Any:
    """A list of numbers, which has no dtype, as the array that its space declares."""
    if isinstance(value, list | tuple) and isinstance(space, Box | MultiBinary | MultiDiscrete):
        return np.asarray(value, dtype=space.dtype)
    return value


def _parameters(call: Any) -> frozenset[str]:
    try:
        return frozenset(inspect.signature(call).parameters)
    except (TypeError, ValueError):  # a builtin, which has none to look at
        return frozenset()


WORD: Final = "gym"
SYNTAX: Final = "gym:module:factory, or gym:module:Id-v0"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = _shaped.distrust_named(WORD)


NAMES: Final = ("reset", "step", "action_space", "observation_space")


def locate(spec: str, api: str | None) -> Source:
    """The factory of a module or file, or what the old Gym's registry has under an id."""
    text = foreign_openers.rest(spec, WORD) or ""
    found = foreign_openers.ID.fullmatch(text)
    registered = None if found is None else _registered(found["module"], found["id"])
    return _shaped.source_of_shape(
        text, word=WORD, family="the old Gym", names=NAMES, wrap=OldGym, registered=registered
    )


def _registered(module: str | None, env_id: str) -> tuple[Callable[..., Any], str]:
    """The factory of an id, and the module that registers it."""
    gym = foreign_openers.need("gym")
    if module is not None:
        foreign_openers.need(module, here=True)
    registry = gym.envs.registration.registry
    known = sorted(getattr(registry, "env_specs", registry))
    if env_id not in known:
        raise foreign_openers.unknown(env_id, "the old Gym", known)
    make = functools.partial(gym.make, env_id)
    if "disable_env_checker" in gym.make.__code__.co_varnames:
        # Gym 0.26 checks with names that NumPy 2 no longer has.
        make = functools.partial(make, disable_env_checker=True)
    return make, module or "gym"
