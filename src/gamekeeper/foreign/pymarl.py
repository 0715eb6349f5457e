"""`pymarl:module:factory`: an environment of PyMARL's shape, as SMAC and SMACv2 have it."""

import inspect
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from gamekeeper.foreign import _shaped
from gamekeeper.foreign._guest import (
    MASK,
    ForeignEnv,
    ForeignStep,
    Given,
    dealt,
    numbered,
    rewards,
    wrong_shape,
)
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source

LIMITED = "episode_limit"
"""Key by which an info says that the limit ended the episode, and of the number itself."""


class PyMarl(ForeignEnv):
    """An environment of PyMARL's shape as a ParallelEnv.

    | | kept | changed |
    |---|---|---|
    | reward | the team's, paid to everybody in full, under the term `team` | |
    | terminated | for all at once | truncated where the info has a true `episode_limit` |
    | avail_actions | in the infos as `action_mask` | |
    | state | `state()`, where the environment tells its size | |
    | seeds | `env.seed(seed)` or `reset(seed=...)` | none where it offers neither |
    | options | | refused: its reset takes none |
    | units that die | live on with the action that the mask leaves them, as in PyMARL | |
    """

    optionless = "PyMARL"
    unknown: tuple[str, ...] = (
        "which agent ended: units that die are still asked for an action",
        "whose reward it is: there is one for all",
        "whether seeds reach all of its randomness, or any where env.seed takes none",
        "the bounds of observations",
    )

    def __init__(self, env: Any, *, name: str) -> None:
        super().__init__(env, name=name)
        facts = env.get_env_info()
        limit = facts.get(LIMITED)
        count, actions = int(facts["n_agents"]), int(facts["n_actions"])
        shape = tuple(np.atleast_1d(facts["obs_shape"]).tolist())
        self._settle(
            numbered(count),
            [Box(-np.inf, np.inf, shape, np.float32)] * count,
            [Discrete(actions)] * count,
            limit=limit if type(limit) is int and limit > 0 else None,
            is_team_paid=True,
        )
        sized = (
            tuple(np.atleast_1d(facts["state_shape"]).tolist()) if "state_shape" in facts else ()
        )
        self.state_space = Box(-np.inf, np.inf, sized, np.float32) if sized else None

    def state(self) -> NDArray[Any]:
        """State, as the environment gives it.

        Raises:
            NotImplementedError: it tells none.
        """
        if self.state_space is None:
            raise NotImplementedError("the environment tells no state")
        return _array(self.guest.get_state())

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        arguments: dict[str, Any] = {}
        if seed is not None:
            if "seed" in inspect.signature(self.guest.reset).parameters:
                arguments["seed"] = seed
            elif _takes_one(getattr(self.guest, "seed", None)):
                self.guest.seed(seed % 2**32)  # as they hand it to numpy.random.seed
        self.guest.reset(**arguments)
        return self._observations(), dict(self._infos({}))

    def _play(self, actions: Given) -> ForeignStep:
        agents = self.possible_agents
        out = self.guest.step([int(actions[agent]) for agent in agents])
        if not isinstance(out, tuple) or len(out) not in (3, 5):
            raise wrong_shape("step", expected="reward, terminated, info", actual=out)
        paid, info = out[-3] if len(out) == 3 else out[1], out[-1]
        over = bool(np.all(out[-2] if len(out) == 3 else out[2]))
        is_cut = len(out) == 5 and bool(np.all(out[3]))
        if isinstance(info, Mapping) and info.get(LIMITED) is True:
            over, is_cut = False, True
        return ForeignStep(
            self._observations(),
            rewards(paid, agents),
            dict.fromkeys(agents, over),
            dict.fromkeys(agents, is_cut),
            self._infos(info if isinstance(info, Mapping) else {}),
        )

    def _observations(self) -> Given:
        seen = dealt(self.guest.get_obs(), self.possible_agents, "get_obs")
        return {agent: _array(observation) for agent, observation in seen.items()}

    def _infos(self, info: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        masks = dealt(self.guest.get_avail_actions(), self.possible_agents, "get_avail_actions")
        return {
            agent: {**info, MASK: np.asarray(mask, dtype=np.int8)} for agent, mask in masks.items()
        }


def _array(values: Any) -> NDArray[Any]:
    """An array as it is; a list of numbers, which has no dtype, as float32."""
    return values if isinstance(values, np.ndarray) else np.asarray(values, dtype=np.float32)


def _takes_one(seed: Any) -> bool:
    return callable(seed) and bool(inspect.signature(seed).parameters)


WORD: Final = "pymarl"
SYNTAX: Final = "pymarl:smacv2.env:StarCraft2Env"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = _shaped.distrust_named(WORD)

NAMES: Final = ("get_env_info", "get_obs", "get_avail_actions", "reset", "step")


def locate(spec: str, api: str | None) -> Source:
    """The factory of a module or file."""
    text = foreign_openers.rest(spec, WORD) or ""
    return _shaped.source_of_shape(text, word=WORD, family="PyMARL", names=NAMES, wrap=PyMarl)
