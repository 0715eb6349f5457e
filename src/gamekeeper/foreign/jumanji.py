"""`jumanji:RobotWarehouse-v0`: one copy of a Jumanji environment."""

import secrets
from collections.abc import Mapping
from types import ModuleType
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Dict, Discrete, MultiDiscrete

from gamekeeper.errors import SpecError
from gamekeeper.foreign._guest import MASK, ForeignEnv, ForeignStep, Given, limit_of, numbered
from gamekeeper.foreign._spaces import Space, box
from gamekeeper.foreign.jaxmarl import key_of, numpy_of
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source

BOARD: Final = "grid"
"""The field that is everybody's board, also where it is as long as there are agents."""
JOINT: Final = "joint_mask"
"""Key of a mask that belongs to no single Discrete action."""
LAST: Final = 2
"""The step type of an episode's end. Source: dm_env.StepType, which Jumanji's repeats."""


class Jumanji(ForeignEnv):
    """A Jumanji environment as a ParallelEnv: compiled once, arrays of NumPy outside.

    | | kept | changed |
    |---|---|---|
    | agents | `agent_0`, ... where it has `num_agents`, else one | |
    | observation | a Dict of its fields; an agent has its row of those with an axis of agents | |
    | masks | as `action_mask` in the observation, int8 | a mask of joint actions: `joint_mask` |
    | reward | of each agent; one for all is paid to everybody in full, under the term `team` | |
    | end | discount 0: terminated; last step with a discount: truncated | an end of all in the |
    | | | tick of the environment's own limit is a truncation ("time limit") |
    | extras | everybody's info, a copy each | |
    | seeds | as for JaxMARL | |
    | options | | refused: its reset takes none |
    """

    optionless = "Jumanji"
    unknown: tuple[str, ...] = (
        "why an episode ended that was over in the tick of the environment's own limit",
        "the bounds of observations, where it declares none",
    )

    def __init__(self, env: Any, jax: ModuleType, *, name: str) -> None:
        """Takes hold of a Jumanji environment; `jax` is handed in, as only its users have it."""
        super().__init__(env, name=name)
        self.metadata["render_modes"] = []
        self._jax = jax
        self._reset, self._step = jax.jit(env.reset), jax.jit(env.step)
        self._key: Any = None
        self._state: Any = None
        self._last: Given = {}
        self._count = int(getattr(env, "num_agents", None) or 0)
        self._is_several = self._count > 0 and env.action_spec.shape[:1] == (self._count,)
        agents = numbered(self._count if self._is_several else 1)
        acting = [self._action_space(row) for row in range(len(agents))]
        self._is_masked = isinstance(acting[0], Discrete)
        is_team_paid = self._is_several and not env.reward_spec.shape
        self._settle(
            agents,
            [self._observation_space()] * len(agents),
            acting,
            limit=limit_of(env),
            is_team_paid=is_team_paid,
        )

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        if seed is not None or self._key is None:
            self._key = key_of(self._jax, secrets.randbits(63) if seed is None else seed)
        self._key, key = self._jax.random.split(self._key)
        self._last = {}
        self._state, timestep = self._reset(key)
        return self._seen(timestep.observation), self._infos(timestep)

    def _play(self, actions: Given) -> ForeignStep:
        agents = self.possible_agents
        # Who has ended has a place in the array still, and its last action stays in it.
        self._last |= actions
        chosen = [self._last[agent] for agent in agents]
        spec = self.guest.action_spec
        action = np.asarray(chosen if self._is_several else chosen[0], dtype=spec.dtype)
        self._state, timestep = self._step(self._state, action)
        over = int(timestep.step_type) == LAST
        paid = np.broadcast_to(np.asarray(timestep.reward), (len(agents),))
        stopped = np.broadcast_to(np.asarray(timestep.discount) == 0, (len(agents),))
        terminated = {agent: bool(stopped[row]) for row, agent in enumerate(agents)}
        return ForeignStep(
            self._seen(timestep.observation),
            {agent: float(paid[row]) for row, agent in enumerate(agents)},
            terminated,
            {agent: over and not terminated[agent] for agent in agents},
            self._infos(timestep),
        )

    def render(self) -> None:
        """Returns None: Jumanji draws a state into a window or a figure of its own."""

    # -- its fields

    def _has_rows(self, name: str, shape: tuple[int, ...]) -> bool:
        return self._is_several and name != BOARD and shape[:1] == (self._count,)

    def _fields(self) -> dict[str, Any]:
        spec = self.guest.observation_spec
        parts = {name: part for name, part in vars(spec).items() if hasattr(part, "shape")}
        parts = {name: part for name, part in parts.items() if not name.startswith("_")}
        if not parts:
            raise SpecError(
                "an observation of Jumanji's has no fields that are arrays",
                expected="a specification of arrays, one level deep",
                actual=repr(spec)[:200],
                fix="wrap the environment so that its observation is a flat record of arrays",
            )
        return parts

    def _observation_space(self) -> Dict:
        spaces: dict[str, Space] = {}
        for name, part in self._fields().items():
            shape = tuple(part.shape)[1:] if self._has_rows(name, part.shape) else tuple(part.shape)
            low, high = getattr(part, "minimum", -np.inf), getattr(part, "maximum", np.inf)
            if self._has_rows(name, part.shape) and np.ndim(low):
                low, high = np.min(low, axis=0), np.max(high, axis=0)
            spaces[self._named(name)] = box(np.asarray(low), np.asarray(high), shape, part.dtype)
        return Dict(spaces)

    def _named(self, name: str) -> str:
        return JOINT if name == MASK and not self._is_masked else name

    def _seen(self, observation: Any) -> Given:
        seen: Given = {agent: {} for agent in self.possible_agents}
        for name in self._fields():
            values = np.array(getattr(observation, name))
            if values.dtype == bool:
                values = values.astype(np.int8)
            has_rows = self._has_rows(name, values.shape)
            for row, fields in enumerate(seen.values()):
                fields[self._named(name)] = values[row].copy() if has_rows else values.copy()
        # A field without axes came out of its array as a scalar: it goes back into one.
        return {agent: _as_arrays(fields) for agent, fields in seen.items()}

    def _infos(self, timestep: Any) -> dict[str, dict[str, Any]]:
        extras = timestep.extras if isinstance(timestep.extras, Mapping) else {}
        shared = numpy_of(self._jax, dict(extras))
        return {agent: dict(shared) for agent in self.possible_agents}

    def _action_space(self, row: int) -> Space:
        spec = self.guest.action_spec
        counts = getattr(spec, "num_values", None)
        if counts is None:
            shape = tuple(spec.shape)[1:] if self._is_several else tuple(spec.shape)
            return box(np.min(spec.minimum), np.max(spec.maximum), shape, spec.dtype)
        if self._is_several:
            return Discrete(int(np.asarray(counts)[row]))
        if np.ndim(counts):
            return MultiDiscrete(np.asarray(counts))
        return Discrete(int(counts))


def _as_arrays(fields: Mapping[str, Any]) -> dict[str, Any]:
    return {name: np.asarray(value) for name, value in fields.items()}


WORD: Final = "jumanji"
SYNTAX: Final = "jumanji:RobotWarehouse-v0"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = foreign_openers.distrust_packages(WORD)


def locate(spec: str, api: str | None) -> Source:
    """The environment that `jumanji.make` knows under the id, with its keyword arguments."""
    name = foreign_openers.rest(spec, WORD) or ""
    package = foreign_openers.need(WORD)
    known = list(package.registered_environments())
    if name not in known:
        raise foreign_openers.unknown(name, "Jumanji", known)

    def build(**kwargs: Any) -> Jumanji:
        return Jumanji(package.make(name, **kwargs), foreign_openers.need("jax"), name=name)

    return foreign_openers.source(WORD, name, build)
