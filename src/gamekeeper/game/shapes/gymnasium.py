"""Gymnasium's shape: one agent, or several in tuples and lists."""

from __future__ import annotations

from typing import Any, Final

import gymnasium

from gamekeeper.errors import SpecError
from gamekeeper.game.shapes.by_agent import dealt, flags, infos, rewards
from gamekeeper.game.shapes.guest import Crossing, Given, Guest, limit_of, numbered
from gamekeeper.game.shapes.spaces import Space, as_gymnasium, idle, several

RESETTING: Final = ("Autoreset", "AutoResetWrapper", "AutoReset")
"""Wrappers that begin the next episode by themselves: an end would never be seen."""


def guest_of(env: Any, *, name: str) -> Guest:
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
            seen=f"{len(seeing)} and {len(acting)}",
        )
    return SeveralAgents(env, seeing, acting, name=name)


class OneAgent(Guest):
    """A Gymnasium environment as a game of one agent, `agent_0`.

    | | kept | changed |
    |---|---|---|
    | reward, terminated, truncated, info | as they come | |
    | seeds, options | handed on | |
    | its end | | the agent leaves the roster; nothing resets by itself |
    """

    why = "there is one agent"

    def __init__(self, env: Any, *, name: str) -> None:
        """Takes hold of an environment of one agent."""
        super().__init__(env, name=name)
        seen, done = as_gymnasium(env.observation_space), as_gymnasium(env.action_space)
        self._settle(numbered(1), [seen], [done])
        (self._agent,) = self.possible_agents

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        observation, info = self.guest.reset(seed=seed, options=options)
        return {self._agent: observation}, {self._agent: info}

    def _play(self, actions: Given) -> Crossing:
        agent = self._agent
        observation, reward, terminated, truncated, info = self.guest.step(actions[agent])
        return Crossing(
            {agent: observation},
            {agent: reward},
            {agent: bool(terminated)},
            {agent: bool(truncated)},
            {agent: info},
        )


class SeveralAgents(Guest):
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
        """Takes hold of an environment of several agents, with their spaces in order."""
        super().__init__(env, name=name)
        limit = limit_of(getattr(env, "unwrapped", env))
        self._settle(numbered(len(acting)), seeing, acting, limit=limit)
        self._idle = {agent: idle(space) for agent, space in self.action_spaces.items()}

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        observations, info = self.guest.reset(seed=seed, options=options)
        agents = self.possible_agents
        return dealt(observations, agents, "observations"), dict(infos(info, agents))

    def _play(self, actions: Given) -> Crossing:
        agents = self.possible_agents
        out = self.guest.step(tuple({**self._idle, **actions}[agent] for agent in agents))
        observations, paid, terminated, truncated, info = out
        return Crossing(
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
            seen=type(env).__name__,
            mend="open one copy; gamekeeper makes many of it",
        )
    layer = env
    while layer is not None:
        if type(layer).__name__ in RESETTING:
            raise SpecError(
                f"{name} begins its next episode by itself",
                expected="an environment that waits for reset after its end",
                seen=f"the wrapper {type(layer).__name__}",
                mend="leave the wrapper out",
            )
        layer = vars(layer).get("env")
