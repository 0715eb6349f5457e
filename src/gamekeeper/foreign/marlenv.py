"""`marlenv:module:factory`: an environment of the package `marlenv`, such as LLE."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from numpy.typing import NDArray

from gamekeeper.foreign import _shaped
from gamekeeper.foreign._guest import MASK, TEAM, ForeignEnv, ForeignStep, Given, numbered
from gamekeeper.foreign._spaces import Space, box
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source


class MarlEnv(ForeignEnv):
    """An environment of the package `marlenv` as a ParallelEnv.

    | | kept | changed |
    |---|---|---|
    | observation | its row of `data`; with extras a Dict of `observation` and `extras` | |
    | available actions | in the infos as `action_mask` | |
    | reward | the team's, paid to everybody in full; of several objectives their sum, and each | |
    | | under a term of its own | |
    | done, truncated | for all at once | done in the tick of its horizon is truncated |
    | state | `state()`: data, then extras, in one array | |
    | seeds | handed on | |
    | options | | refused: its reset takes none |
    """

    optionless = "a marlenv environment"
    unknown: tuple[str, ...] = (
        "which agent ended: there is one end for all",
        "whose reward it is: there is one for all",
        "the bounds of observations",
    )

    def __init__(self, env: Any, *, name: str) -> None:
        super().__init__(env, name=name)
        count = int(env.n_agents)
        seen: Space = Box(-np.inf, np.inf, tuple(env.observation_shape), np.float32)
        self._has_extras = int(np.prod(env.extras_shape)) > 0
        if self._has_extras:
            extras = Box(-np.inf, np.inf, tuple(env.extras_shape), np.float32)
            seen = Dict({"observation": seen, "extras": extras})
        self._terms_of_vector = [TEAM]
        if int(env.reward_space.size) > 1:
            names = getattr(env.reward_space, "labels", None) or range(int(env.reward_space.size))
            self._terms_of_vector = [f"objective_{name}" for name in names]
        horizon = getattr(env, "horizon", None)
        self._settle(
            numbered(count),
            [seen] * count,
            [_action_space(env)] * count,
            limit=horizon if type(horizon) is int else None,
            is_team_paid=True,
        )
        size = int(np.prod(env.state_shape)) + int(np.prod(env.state_extras_shape))
        self.state_space = Box(-np.inf, np.inf, (size,), np.float32)
        self._paid: NDArray[Any] = np.zeros(1, np.float32)

    def state(self) -> NDArray[np.float32]:
        """The state and its extras, flat."""
        state = self.guest.get_state()
        parts = [np.ravel(np.asarray(part, np.float32)) for part in (state.data, state.extras)]
        return np.concatenate(parts)

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        observation, _ = self.guest.reset() if seed is None else self.guest.reset(seed=seed % 2**32)
        return self._dealt(observation), self._infos(observation, {})

    def _play(self, actions: Given) -> ForeignStep:
        agents = self.possible_agents
        step = self.guest.step(np.asarray([actions[agent] for agent in agents]))
        self._paid = np.ravel(step.reward)
        paid = float(sum(float(part) for part in self._paid))
        return ForeignStep(
            self._dealt(step.obs),
            dict.fromkeys(agents, paid),
            dict.fromkeys(agents, bool(step.done)),
            dict.fromkeys(agents, bool(step.truncated)),
            self._infos(step.obs, step.info),
        )

    def _terms(self, rewards: Mapping[str, Any]) -> dict[str, dict[str, float]]:
        named = dict(zip(self._terms_of_vector, map(float, self._paid), strict=False))
        return {agent: dict(named) for agent in rewards}

    def _dealt(self, observation: Any) -> Given:
        rows = enumerate(self.possible_agents)
        if not self._has_extras:
            return {agent: observation.data[row] for row, agent in rows}
        return {
            agent: {"observation": observation.data[row], "extras": observation.extras[row]}
            for row, agent in rows
        }

    def _infos(self, observation: Any, info: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        masks = observation.available_actions
        common = {key: value for key, value in info.items() if isinstance(key, str)}
        return {
            agent: {**common, MASK: np.asarray(masks[row], dtype=np.int8)}
            for row, agent in enumerate(self.possible_agents)
        }


def _action_space(env: Any) -> Space:
    """One agent's actions: all have as many, in one array."""
    space = env.action_space
    if space.is_discrete:
        return Discrete(int(env.n_actions))
    return box(space.low[0], space.high[0], tuple(space.shape[1:]), np.float32)


WORD: Final = "marlenv"
SYNTAX: Final = "marlenv:path/to/file.py:factory"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = _shaped.distrust_named(WORD)

NAMES: Final = ("n_agents", "observation_shape", "available_actions", "reset", "step")


def locate(spec: str, api: str | None) -> Source:
    """The factory of a module or file."""
    text = foreign_openers.rest(spec, WORD) or ""
    return _shaped.source_of_shape(text, word=WORD, family="marlenv", names=NAMES, wrap=MarlEnv)
