"""Gymnasium: one agent as an Env, all agents as one, every agent of many copies as a VectorEnv."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces

from gamekeeper.adapters.learner_steps import LearnerTicks, LearnerTurns
from gamekeeper.adapters.requirements import closed_on_error, require_policies
from gamekeeper.episodes.exception_text import said_by
from gamekeeper.errors import OrderError, SpecError, check_choice
from gamekeeper.interface.action_mask import Reader, reader
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.joint_policy import Choices, JointPolicy
from gamekeeper.interface.legality import forbidden
from gamekeeper.interface.opening import Opened, open_env
from gamekeeper.interface.slim import slim
from gamekeeper.runs.recording import joint_policy_of
from gamekeeper.vector.vector_factory import make

FIX_OF_MASKED: Final = (
    "an algorithm that reads masks (they stand in infos or observations): plain DQN and PPO don't"
)
EPISODES: Final = 100
"""Episodes that an agent has to come into the game, until it is taken for one that never does."""


def single_agent(
    spec: object, agent: str, *, others: Choices = None, env_kwargs: Mapping[str, Any] | None = None
) -> AgentEnv:
    """One agent of a multi-agent environment as a `gymnasium.Env`; the others follow policies.

    | | |
    |---|---|
    | kept | the agent's own spaces, end (terminated apart from truncated) and info; its rewards, all that it was paid between two of its decisions; the mask, in the info or the observation; seeds: `reset(seed=s)` is the environment's own |
    | changed | what the others do until this agent decides first is played inside `reset`, in an AEC environment the turns until it decides again inside `step`. Who leaves without an ending counts as terminated, and is shown its last observation again |
    | lost | what it was paid before its first decision; what happens after its end; episodes that it had no decision in (`reset` begins another one); the others' observations and rewards (`gk.record` keeps them) |
    | refused | an agent that nobody knows, or that has nothing to decide in 100 episodes; others without a policy |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        agent: the agent that `step`'s actions are of.
        others: policies of the others, one for all or by agent or role; None for an environment
            with one agent.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*.
    """  # noqa: E501  # a row of a table is one line
    opened = open_env(spec, **dict(env_kwargs or {}))
    with closed_on_error(opened.env):
        agents = list(getattr(opened.env, "possible_agents", ()))
        if agent not in agents:
            raise SpecError(
                f"the environment has no agent called {agent!r}",
                where="agent",
                expected=", ".join(map(str, agents)),
                actual=repr(agent),
                fix="name one of its possible agents",
            )
        declared = declared_contract(None, opened)
        require_policies([other for other in agents if other != agent], others, declared)
        mask = reader(None if declared is None else declared.mask_of(agent))
        return AgentEnv(opened, agent, joint_policy_of(others, opened.env, declared), mask)


class AgentEnv(gymnasium.Env[Any, Any]):
    """Use `single_agent`.

    Attributes:
        agent: the agent that `step`'s actions are of.
        env: the multi-agent environment.
    """

    def __init__(self, opened: Opened, agent: Any, policies: JointPolicy, mask: Reader) -> None:
        self.env: Any = slim(opened.env)
        self.agent = agent
        self.metadata = dict(getattr(opened.env, "metadata", None) or {})
        self.render_mode = getattr(opened.env, "render_mode", None)
        self.observation_space = self.env.observation_space(agent)
        self.action_space = self.env.action_space(agent)
        self._policies, self._mask = policies, mask
        kind = LearnerTurns if opened.api == "aec" else LearnerTicks
        self._steps = kind(self.env, [agent], policies)
        self._seed, self._episode = 0, -1

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode; returns the agent's first observation and info.

        Raises:
            SpecError: it has nothing to decide in 100 episodes.
        """
        super().reset(seed=seed)
        if seed is not None:
            self._seed, self._episode = seed, -1
        for _ in range(EPISODES):
            self._episode += 1
            self._policies.begin(self._seed, self._episode)
            first = self._steps.begin(seed, options).get(self.agent)
            if first is not None and not first.ended:
                return first.observation, dict(first.info or {})
            seed = None
        raise SpecError(
            f"{self.agent!r} has nothing to decide",
            where="reset",
            expected="an agent that comes into the game",
            actual=f"{EPISODES} episodes without it",
            fix="take another agent",
        )

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Takes the agent's action, and plays on until it decides again.

        Raises:
            ActionError: the environment raised after the agent did what its mask forbids.
            OrderError: the agent has ended, or there was no reset.
        """
        seen = self._steps.live.get(self.agent)
        if seen is None:
            raise OrderError("the agent has no decision to make", where="step", fix="reset() first")
        try:
            after = self._steps.act({self.agent: action})[self.agent]
        except Exception as error:
            space, mask = self.action_space, self._mask(seen.observation, seen.info)
            masked = forbidden(
                self.agent, action, space, mask, then=said_by(error), fix=FIX_OF_MASKED
            )
            if masked is None:
                raise
            raise masked from error
        info = dict(after.info or {})
        return after.observation, after.reward, after.terminated, after.truncated, info

    def render(self) -> Any:
        """Renders the environment."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()


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
        observe: `agents`: a Dict of all agents' observations. `state`: the environment's `state()`.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*; or it has no `state_space`.
    """  # noqa: E501  # a row of a table is one line
    check_choice(observe, ("agents", "state"), "there is no such view", where="observe")
    opened = open_env(spec, **dict(env_kwargs or {}))
    if opened.api != "parallel":
        opened.env.close()
        raise SpecError(
            "agents that act in turn have no joint action",
            where="joint",
            actual="aec",
            expected="a Parallel environment",
            fix="joint(lambda: gk.to_parallel(env))",
        )
    return JointEnv(slim(opened.env), observe)


class JointEnv(gymnasium.Env[Any, Any]):
    """Use `joint`."""

    def __init__(self, env: Any, observe: str) -> None:
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
                    "the environment declares no state_space",
                    where="observe='state'",
                    actual=repr(space),
                    fix="observe='agents'",
                )
            self.observation_space = space

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode."""
        super().reset(seed=seed)
        more = {} if options is None else {"options": dict(options)}
        observations, infos = self.env.reset(seed=seed, **more)
        return self._seen(observations), self._info({}, {}, {}, infos)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Plays a tick of all agents."""
        live = self.env.agents
        observations, rewards, terms, truncs, infos = self.env.step(
            {agent: action[str(agent)] for agent in live}
        )
        is_over = not self.env.agents
        terminated = is_over and any(terms.values())
        info = self._info(rewards, terms, truncs, infos)
        total = float(sum(rewards.values()))
        return self._seen(observations), total, terminated, is_over and not terminated, info

    def render(self) -> Any:
        """Renders the environment."""
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

    def _info(self, rewards: Any, terms: Any, truncs: Any, infos: Any) -> dict[str, Any]:
        return {
            "rewards": dict(rewards),
            "terminations": dict(terms),
            "truncations": dict(truncs),
            "live": np.array([agent in self.env.agents for agent in self.agents]),
            "infos": {a: dict(info) for a, info in infos.items()},
        }


def nothing(space: spaces.Space[Any]) -> Any:
    """Returns zeros in the form of a space, for an agent that isn't live."""
    if isinstance(space, spaces.Dict):
        return {key: nothing(part) for key, part in space.spaces.items()}
    if isinstance(space, spaces.Tuple):
        return tuple(nothing(part) for part in space.spaces)
    if isinstance(space, spaces.Discrete):
        return space.start
    return np.zeros(space.shape or (), space.dtype)


def vector(spec: object, num_envs: int, *, absent: str = "refuse", **options: Any) -> Any:
    """Every agent of every copy as a sub-environment of a `gymnasium.vector.VectorEnv`.

    | | |
    |---|---|
    | kept | every agent's own end (terminated apart from truncated) and final observation; both autoreset modes; masks in `infos["action_mask"]`; seeds: copy e plays the episodes e, e + num_envs, ... of the run |
    | changed | with `absent="zeros"`, an agent that isn't in the game while its copy plays is shown zeros and reward 0, neither terminated nor truncated. Whoever doesn't look at `infos["live"]`, as Gymnasium's own wrappers, counts these steps |
    | lost | infos but for the mask |
    | refused | agents that differ in their spaces, or act in turn; an agent that ends before its copy does, or joins later (`absent="zeros"` lets it pass): Gymnasium's environments begin anew as they end, and an agent can't before its copy does |

    Args:
        spec: where the environment comes from.
        num_envs: number of sub-environments.
        absent: `refuse` or `zeros`, as above.
        **options: of `gk.vector.make`.
    Raises:
        SpecError: see *refused*; that an agent isn't in the game is seen as it happens.
    """  # noqa: E501  # a row of a table is one line
    return make(spec, num_envs, **options).as_gymnasium(absent=absent)
