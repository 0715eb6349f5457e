"""Gymnasium: one agent as an Env, all agents as one, every agent of many copies as a VectorEnv."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces

from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Choices
from gamekeeper.game.converting.slim import slim
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.open import Opened, open_env
from gamekeeper.record.recording import cast_of
from gamekeeper.vector.front import make

SEEDS: Final = 2**31


def single_agent(
    spec: object,
    agent: str,
    *,
    others: Choices = None,
    env_kwargs: Mapping[str, Any] | None = None,
) -> AgentEnv:
    """One agent of a multi-agent environment as a `gymnasium.Env`; the others follow policies.

    | | |
    |---|---|
    | kept | the agent's own spaces, end (terminated apart from truncated) and info; its rewards, all that it was paid between two of its decisions; the mask, in the info or the observation; seeds: `reset(seed=s)` is the environment's own |
    | changed | in an AEC environment the others' turns are played inside `step`, until it is this agent's turn again or it has ended |
    | lost | what happens after this agent's end; the others' observations and rewards (`gk.record` keeps them) |
    | refused | an agent that isn't there as the episode begins; others without a policy |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        agent: who is played by `step`'s actions.
        others: policies of the others, one for all or by agent or role; None is for an environment
            with nobody else.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*.
    """  # noqa: E501  # a row of a table is one line
    opened = open_env(spec, **dict(env_kwargs or {}))
    agents = list(getattr(opened.env, "possible_agents", ()))
    if agent not in agents:
        raise SpecError(
            f"nobody is called {agent!r}", where="agent", expected=", ".join(map(str, agents)),
            seen=repr(agent),
        )  # fmt: skip
    if others is None and len(agents) > 1:
        raise SpecError(
            "the other agents have no policy",
            where="others",
            expected=f"policies for {', '.join(str(a) for a in agents if a != agent)}",
            seen="none",
            mend="others='random', or others={'role': 'module:callable'}",
        )
    return AgentEnv(opened, agent, others)


class AgentEnv(gymnasium.Env[Any, Any]):
    """Use `single_agent`.

    Attributes:
        agent: who is played by `step`'s actions.
        env: the multi-agent environment.
    """

    def __init__(self, opened: Opened, agent: Any, others: Choices) -> None:
        """Takes over an open environment."""
        self.env: Any = slim(opened.env)
        self.agent, self._api = agent, opened.api
        self.metadata = dict(getattr(opened.env, "metadata", None) or {})
        self.render_mode = getattr(opened.env, "render_mode", None)
        self.observation_space = self.env.observation_space(agent)
        self.action_space = self.env.action_space(agent)
        self._cast = cast_of(others, opened.env, declared_contract(None, opened))
        self._seed, self._episode = 0, -1
        self._given: tuple[Any, Any] = ({}, {})

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode: what the agent is given first."""
        super().reset(seed=seed)
        self._episode += 1
        if seed is not None:
            self._seed, self._episode = seed, 0
        more = {} if options is None else {"options": dict(options)}
        self._cast.begin(self._seed, self._episode)
        if self._api == "parallel":
            self._given = self.env.reset(seed=seed, **more)
            return self._first(self._given[0].get(self.agent), self._given[1].get(self.agent))
        self.env.reset(seed=seed, **more)
        observation, _, _, _, info = self._turns()
        return self._first(observation, info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """The agent's action, and all that follows until it decides again."""
        if self._api == "aec":
            self.env.step(action)
            observation, reward, terminated, truncated, info = self._turns()
            return observation, float(reward), bool(terminated), bool(truncated), dict(info or {})
        seen, told = self._given
        acts = {
            a: action if a == self.agent else self._cast.act(a, seen[a], told.get(a, {}))
            for a in self.env.agents
        }
        out = self.env.step(acts)
        self._given, me = (out[0], out[4]), self.agent
        return out[0][me], float(out[1][me]), bool(out[2][me]), bool(out[3][me]), dict(out[4][me])

    def render(self) -> Any:
        """As the environment renders."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def _first(self, observation: Any, info: Any) -> tuple[Any, dict[str, Any]]:
        if observation is None:
            raise SpecError(
                f"{self.agent!r} isn't there as the episode begins",
                where="reset",
                expected="an agent that plays from the start",
                mend="take another agent: who joins late has no first observation to return",
            )
        return observation, dict(info or {})

    def _turns(self) -> tuple[Any, Any, Any, Any, Any]:
        """Plays the others' turns; what the agent is given then."""
        env, me = self.env, self.agent
        while env.agents:
            given: tuple[Any, Any, Any, Any, Any] = env.last()
            if env.agent_selection == me:
                return given
            observation, _, terminated, truncated, info = given
            if terminated or truncated:
                env.step(None)
            else:
                env.step(self._cast.act(env.agent_selection, observation, info))
        return None, 0.0, True, False, {}


def joint(
    spec: object, *, observe: str = "agents", env_kwargs: Mapping[str, Any] | None = None
) -> JointEnv:
    """All agents of a Parallel environment as one `gymnasium.Env`, for centralised control.

    | | |
    |---|---|
    | kept | every agent's observation and action, by name, in Dict spaces; rewards, ends, masks and infos by agent in `info["rewards"]`, `info["terminations"]`, `info["truncations"]`, `info["live"]`, `info["infos"]`; seeds |
    | changed | the reward is the sum of all agents'; the episode is over when the last agent has ended, *truncated* where nobody was terminated in that last step; an agent that isn't there shows zeros, and its actions are passed over |
    | lost | nothing |
    | refused | AEC environments (`gk.to_parallel` makes them Parallel) |

    Args:
        spec: where the environment comes from.
        observe: `agents`: a Dict of everybody's observation. `state`: the environment's `state()`.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*; or it has no `state_space`.
    """  # noqa: E501  # a row of a table is one line
    opened = open_env(spec, **dict(env_kwargs or {}))
    if opened.api != "parallel":
        raise SpecError(
            "agents that act in turn have no joint action", where="joint", seen="aec",
            expected="a Parallel environment", mend="joint(lambda: gk.to_parallel(env))",
        )  # fmt: skip
    return JointEnv(slim(opened.env), observe)


class JointEnv(gymnasium.Env[Any, Any]):
    """Use `joint`.

    Attributes:
        env: the multi-agent environment.
    """

    def __init__(self, env: Any, observe: str) -> None:
        """Takes over an environment."""
        self.env, self._sees_state = env, observe == "state"
        self.agents = list(env.possible_agents)
        self.metadata = dict(getattr(env, "metadata", None) or {})
        self.render_mode = getattr(env, "render_mode", None)
        seen = {str(a): env.observation_space(a) for a in self.agents}
        self.observation_space: spaces.Space[Any] = spaces.Dict(seen)
        self.action_space = spaces.Dict({str(a): env.action_space(a) for a in self.agents})
        if self._sees_state:
            space = getattr(env.unwrapped, "state_space", None)
            if not isinstance(space, spaces.Space):
                raise SpecError(
                    "the environment declares no state_space", where="observe='state'",
                    seen=repr(space), mend="observe='agents'",
                )  # fmt: skip
            self.observation_space = space

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode."""
        super().reset(seed=seed)
        more = {} if options is None else {"options": dict(options)}
        observations, infos = self.env.reset(seed=seed, **more)
        return self._seen(observations), self._told({}, {}, {}, infos)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One tick of everybody."""
        live = self.env.agents
        observations, rewards, terms, truncs, infos = self.env.step(
            {agent: action[str(agent)] for agent in live}
        )
        is_over = not self.env.agents
        terminated = is_over and any(terms.values())
        told = self._told(rewards, terms, truncs, infos)
        total = float(sum(rewards.values()))
        return self._seen(observations), total, terminated, is_over and not terminated, told

    def render(self) -> Any:
        """As the environment renders."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def _seen(self, observations: Mapping[Any, Any]) -> Any:
        if self._sees_state:
            return self.env.state()
        return {
            str(agent): observations[agent]
            if agent in observations
            else nothing(self.env.observation_space(agent))
            for agent in self.agents
        }

    def _told(self, rewards: Any, terms: Any, truncs: Any, infos: Any) -> dict[str, Any]:
        live = [agent in self.env.agents for agent in self.agents]
        return {
            "rewards": dict(rewards), "terminations": dict(terms), "truncations": dict(truncs),
            "live": np.array(live), "infos": {a: dict(info) for a, info in infos.items()},
        }  # fmt: skip


def nothing(space: spaces.Space[Any]) -> Any:
    """Zeros in the form of a space, for an agent that isn't there."""
    if isinstance(space, spaces.Dict):
        return {key: nothing(part) for key, part in space.spaces.items()}
    if isinstance(space, spaces.Tuple):
        return tuple(nothing(part) for part in space.spaces)
    if isinstance(space, spaces.Discrete):
        return space.start
    return np.zeros(space.shape or (), space.dtype)


def vector(spec: object, num_envs: int, **options: Any) -> Any:
    """Every agent of every copy as a sub-environment of a `gymnasium.vector.VectorEnv`.

    Args:
        spec: where the environment comes from.
        num_envs: how many copies.
        **options: of `gk.vector.make`.
    Raises:
        SpecError: agents differ in their spaces, or act in turn.
    """
    return make(spec, num_envs, **options).as_gymnasium()
