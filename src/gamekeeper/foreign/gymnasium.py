"""`gymnasium:CartPole-v1`: a Gymnasium environment, also module:factory; one agent, or tuples."""

import functools
from collections.abc import Callable
from typing import Any, Final

import gymnasium

from gamekeeper.errors import SpecError
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
)
from gamekeeper.foreign._spaces import Space, as_gymnasium, idle, several
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.distributions import distrust_module
from gamekeeper.interface.env_source import Source
from gamekeeper.interface.modules import split_file

RESETTING: Final = ("Autoreset", "AutoResetWrapper", "AutoReset")
"""Wrappers that begin the next episode by themselves: an end would never be seen."""


def guest_of(env: Any, *, name: str) -> ForeignEnv:
    """The guest for a Gymnasium environment: of several agents where both spaces are Tuples.

    Raises:
        SpecError: it resets itself, holds many copies, or its spaces are of different numbers.
    """
    _refuse(env, name)
    acting, seeing = several(env.action_space), several(env.observation_space)
    if acting is None or seeing is None:
        return OneAgent(env, name=name)
    if len(acting) != len(seeing):
        raise SpecError(
            f"{name} has spaces of different numbers of agents",
            expected="as many observation spaces as action spaces",
            actual=f"{len(seeing)} and {len(acting)}",
            fix="give the environment one observation space and one action space for each agent",
        )
    return SeveralAgents(env, seeing, acting, name=name)


class OneAgent(ForeignEnv):
    """A Gymnasium environment as a game of one agent, `agent_0`.

    | | kept | changed |
    |---|---|---|
    | reward, terminated, truncated, info | as they come | |
    | seeds, options | handed on | |
    | its end | | the agent leaves the roster; nothing resets by itself |
    """

    why = "there is one agent"

    def __init__(self, env: Any, *, name: str) -> None:
        super().__init__(env, name=name)
        seen, done = as_gymnasium(env.observation_space), as_gymnasium(env.action_space)
        self._settle(numbered(1), [seen], [done])
        (self._agent,) = self.possible_agents

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        observation, info = self.guest.reset(seed=seed, options=options)
        return {self._agent: observation}, {self._agent: info}

    def _play(self, actions: Given) -> ForeignStep:
        agent = self._agent
        observation, reward, terminated, truncated, info = self.guest.step(actions[agent])
        return ForeignStep(
            {agent: observation},
            {agent: reward},
            {agent: bool(terminated)},
            {agent: bool(truncated)},
            {agent: info},
        )


class SeveralAgents(ForeignEnv):
    """A Gymnasium environment that takes a list of actions: rware 2.0, lbforaging 2.0, and others.

    | | kept | changed |
    |---|---|---|
    | rewards | one of each agent; one alone is paid to all in full | |
    | terminated, truncated | one of each agent, or one for all | an end of all in the tick of the |
    | | | environment's own limit is a truncation ("time limit") |
    | info | one of each agent, or everybody's, a copy each | a mask with a row for each agent |
    | | | stands in their infos as `action_mask` |
    | who has ended | | no action is asked of it; the list still has one, of its space's zero |
    """

    unknown: tuple[str, ...] = (
        "why an episode ended that was over in the tick of the environment's own limit",
        "whether the environment looks at the action of an agent that has ended",
        "whose reward it is, where there is one for all",
    )

    def __init__(self, env: Any, seeing: list[Space], acting: list[Space], *, name: str) -> None:
        super().__init__(env, name=name)
        limit = limit_of(getattr(env, "unwrapped", env))
        self._settle(numbered(len(acting)), seeing, acting, limit=limit)
        self._idle = {agent: idle(space) for agent, space in self.action_spaces.items()}

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        observations, info = self.guest.reset(seed=seed, options=options)
        agents = self.possible_agents
        return dealt(observations, agents, "observations"), dict(infos(info, agents))

    def _play(self, actions: Given) -> ForeignStep:
        agents = self.possible_agents
        out = self.guest.step(tuple({**self._idle, **actions}[agent] for agent in agents))
        observations, paid, terminated, truncated, info = out
        return ForeignStep(
            dealt(observations, agents, "observations"),
            rewards(paid, agents),
            flags(terminated, agents, "terminated"),
            flags(truncated, agents, "truncated"),
            infos(info, agents),
        )


def _refuse(env: Any, name: str) -> None:
    if isinstance(env, gymnasium.vector.VectorEnv):
        raise SpecError(
            f"{name} holds {env.num_envs} copies of an environment",
            expected="one copy",
            actual=type(env).__name__,
            fix="open one copy; gamekeeper makes many of it",
        )
    layer = env
    while layer is not None:
        if type(layer).__name__ in RESETTING:
            raise SpecError(
                f"{name} begins its next episode by itself",
                expected="an environment that waits for reset after its end",
                actual=f"the wrapper {type(layer).__name__}",
                fix="leave the wrapper out",
            )
        layer = vars(layer).get("env")


WORD: Final = "gymnasium"
SYNTAX: Final = "gymnasium:CartPole-v1"
ORDER: Final = 5
"""Before callables: a Gymnasium environment may be one."""


def matches(spec: object) -> bool:
    """Tells whether it begins with `gymnasium:`, or is a Gymnasium environment already."""
    return isinstance(spec, gymnasium.Env) or foreign_openers.rest(spec, WORD) is not None


def locate(spec: Any, api: str | None) -> Source:
    """The registered environment, the factory of a module or file, or the object itself."""
    if isinstance(spec, gymnasium.Env):
        return _of_object(spec)
    text = foreign_openers.rest(spec, WORD) or ""
    found = foreign_openers.ID.fullmatch(text)
    if found is not None:
        return source_of_id(found["module"], found["id"], f"{WORD}:{text}")
    if ":" in text or split_file(text) is not None:
        factory, module, facts = foreign_openers.factory_named(text)
        return foreign_openers.source(
            WORD,
            text,
            functools.wraps(factory, updated=())(_hosted(factory, text)),
            accepts=factory,
            pip=module.partition(".")[0],
            facts=facts,
        )
    raise foreign_openers.unknown(text, "Gymnasium", sorted(gymnasium.registry))


def distrust(spec: object) -> str | None:
    """None for an id that is registered already; of a module what is said of any module."""
    if isinstance(spec, gymnasium.Env):
        return "it was recorded from an object in memory, which no text can build again"
    text = foreign_openers.rest(spec, WORD) or ""
    found = foreign_openers.ID.fullmatch(text)
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
        foreign_openers.need(module, here=True)
    try:
        entry = gymnasium.spec(env_id)
    except gymnasium.error.Error as error:
        missing = foreign_openers.unknown(env_id, "Gymnasium", sorted(gymnasium.registry))
        raise SpecError(
            missing.what,
            where=shown,
            expected=missing.expected,
            actual=f"{error}; {missing.actual}",
            fix="use one of these, or name the module that registers it: gymnasium:module:Id-v0",
        ) from None
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
        facts=foreign_openers.package_fact(module or home),
    )


def _hosted(make: Callable[..., Any], name: str) -> Callable[..., object]:
    def build(**kwargs: Any) -> object:
        env = make(**kwargs)
        if not isinstance(env, gymnasium.Env):
            raise SpecError(
                f"{name} built something that is no Gymnasium environment",
                where=name,
                expected="a gymnasium.Env",
                actual=f"{type(env).__module__}.{type(env).__qualname__}",
                fix="an environment of the old Gym's shape opens as gym:...",
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
        facts=foreign_openers.package_fact(kind.__module__),
    )
