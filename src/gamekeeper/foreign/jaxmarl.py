"""`jaxmarl:MPE_simple_spread_v3`: one copy of a JaxMARL environment."""

import inspect
import secrets
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any, Final

import numpy as np

from gamekeeper.foreign._guest import ALL, MASK, ForeignEnv, ForeignStep, Given, limit_of
from gamekeeper.foreign._spaces import Space, as_gymnasium
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source


class JaxMarl(ForeignEnv):
    """A JaxMARL environment as a ParallelEnv: compiled once, arrays of NumPy outside.

    | | kept | changed |
    |---|---|---|
    | agents | by their own names | |
    | step | `step_env`, which doesn't reset by itself | |
    | dones | of each agent; one who hasn't ended when `__all__` comes is truncated | an end of |
    | | | all in the tick of `max_steps` is a truncation ("time limit") |
    | available actions | in the infos as `action_mask`, where the environment has them | |
    | infos | an agent's own where a value is by agent, else the whole, a copy each | |
    | seeds | all 64 bits: `PRNGKey(low 32)`, the high ones folded in unless they are 0 | |
    | options | | refused: its reset takes none |

    Sums of floats are in XLA's order, which may be another on another processor or version: replay
    there with a tolerance.
    """

    optionless = "JaxMARL"
    unknown: tuple[str, ...] = (
        "why an episode ended that was over in the tick of max_steps",
        "the roster before the end: agents that are done stay in its arrays",
    )

    def __init__(self, env: Any, jax: ModuleType, *, name: str) -> None:
        """Takes hold of a JaxMARL environment; `jax` is handed in, as only its users have it."""
        super().__init__(env, name=name)
        self._jax = jax
        self._reset, self._step = jax.jit(env.reset), jax.jit(env.step_env)
        self._key: Any = None
        self._state: Any = None
        self._last: Given = {}
        self._own = {str(agent): agent for agent in env.agents}  # some are numbers
        self._masks: Callable[[Any], Mapping[str, Any]] | None = self._masks_of(env)
        self._settle(
            list(self._own),
            [_space(env.observation_space, own) for own in self._own.values()],
            [_space(env.action_space, own) for own in self._own.values()],
            limit=limit_of(env),
        )

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        if seed is not None or self._key is None:
            self._key = key_of(self._jax, secrets.randbits(63) if seed is None else seed)
        self._last = {}
        observations, self._state = self._reset(self._next_key())
        return self._seen(observations), dict(self._infos({}))

    def _play(self, actions: Given) -> ForeignStep:
        # Who has ended has a place in the arrays still, and its last action stays in it.
        self._last |= actions
        chosen = {self._own[agent]: np.asarray(done) for agent, done in self._last.items()}
        observations, self._state, paid, dones, info = self._step(
            self._next_key(), self._state, chosen
        )
        over = bool(dones[ALL])
        ended = {agent: bool(dones.get(own, over)) for agent, own in self._own.items()}
        return ForeignStep(
            self._seen(observations),
            {agent: float(paid[own]) for agent, own in self._own.items()},
            ended,
            {agent: over and not done for agent, done in ended.items()},
            self._infos(info),
        )

    def render(self) -> None:
        """Returns None: JaxMARL draws whole episodes afterwards, with visualizers of its own."""

    def _next_key(self) -> Any:
        self._key, key = self._jax.random.split(self._key)
        return key

    def _seen(self, observations: Mapping[str, Any]) -> Given:
        return {agent: numpy_of(self._jax, observations[own]) for agent, own in self._own.items()}

    def _infos(self, info: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        shared = numpy_of(self._jax, dict(info))
        masks = None if self._masks is None else self._masks(self._state)
        infos: dict[str, dict[str, Any]] = {}
        for agent, own in self._own.items():
            info_of = infos[agent] = {
                str(key): value[own] if isinstance(value, Mapping) and own in value else value
                for key, value in shared.items()
            }
            if masks is not None:
                info_of[MASK] = np.array(masks[own], dtype=np.int8)
        return infos

    def _masks_of(self, env: Any) -> Callable[[Any], Mapping[str, Any]] | None:
        """The environment's masks; None where it never wrote that method."""
        base = next((k for k in type(env).__mro__ if k.__name__ == "MultiAgentEnv"), None)
        own = getattr(type(env), "get_avail_actions", None)
        if own is None or own is getattr(base, "get_avail_actions", None):
            return None
        return self._jax.jit(env.get_avail_actions)  # type: ignore[no-any-return]


def key_of(jax: ModuleType, seed: int) -> Any:
    """A key of all 64 bits of a seed; of a small one the same key as everybody's."""
    key = jax.random.PRNGKey(seed & 0xFFFFFFFF)
    return jax.random.fold_in(key, seed >> 32) if seed >> 32 else key


def numpy_of(jax: ModuleType, tree: Any) -> Any:
    """The same nested value with writable arrays of NumPy in place of JAX's."""
    return jax.tree_util.tree_map(np.array, tree)


def _space(ask: Callable[..., Any], agent: object) -> Space:
    # Some of its environments have one space for all, and a method that takes no agent.
    return as_gymnasium(ask(agent) if inspect.signature(ask).parameters else ask())


WORD: Final = "jaxmarl"
SYNTAX: Final = "jaxmarl:MPE_simple_spread_v3"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = foreign_openers.distrust_packages(WORD)


def locate(spec: str, api: str | None) -> Source:
    """The environment that `jaxmarl.make` knows under the name, with its keyword arguments."""
    name = foreign_openers.rest(spec, WORD) or ""
    package = foreign_openers.need(WORD)
    known = list(getattr(package, "registered_envs", ()))
    if known and name not in known:
        raise foreign_openers.unknown(name, "JaxMARL", known)

    def build(**kwargs: Any) -> JaxMarl:
        return JaxMarl(package.make(name, **kwargs), foreign_openers.need("jax"), name=name)

    return foreign_openers.source(WORD, name, build)
