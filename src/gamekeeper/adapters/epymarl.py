"""Environments that EPyMARL's runners step, with observations and masks of fixed length.

`multi_agent_env` is what users call, `gymma` what EPyMARL's registry calls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.requirements import checked, closed_on_error, learners_of, require_policies
from gamekeeper.contract import Contract
from gamekeeper.errors import ActionError, OrderError, SpecError, check_choice
from gamekeeper.interface.action_mask import legal_flags, reader
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.joint_policy import Choices
from gamekeeper.interface.opening import Opened, open_env
from gamekeeper.interface.slim import slim
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.runs.recording import joint_policy_of
from gamekeeper.vector.vector_form import MASK


class LastSeen:
    """Vectors out of one agent's observations, actions and masks.

    Attributes:
        length: of its observation.
        actions: number of its actions, counted from `start`.
        noop: the action that it may take where it isn't live.
    Raises:
        SpecError: its actions aren't Discrete, or its observations have no fixed length.
    """

    def __init__(self, env: Any, contract: Contract, agent: Any) -> None:
        space, action = env.observation_space(agent), env.action_space(agent)
        if not isinstance(action, spaces.Discrete):
            raise SpecError(
                "EPyMARL has numbered actions only",
                where=f"action_space({agent!r})",
                expected="Discrete",
                actual=str(action)[:200],
                fix="choose some actions and number them, in the environment",
            )
        if isinstance(space, spaces.Dict):
            rest = {key: part for key, part in space.spaces.items() if key != MASK}
            space = spaces.Dict(rest)
        if not space.is_np_flattenable:
            raise SpecError(
                "observations have no fixed length",
                where=f"observation_space({agent!r})",
                expected="a space that Gymnasium flattens to a Box",
                actual=str(space)[:200],
                fix="observe numbers of a fixed shape, in the environment",
            )
        self._space = space
        self._mask = reader(contract.mask_of(agent))
        self.length = int(spaces.flatdim(space))
        self.start, self.actions = int(action.start), int(action.n)
        noop = contract.noop_of(agent)
        self.noop = noop - self.start if type(noop) is int else 0

    def flat(self, observation: Any) -> NDArray[Any]:
        """Returns an observation as a vector."""
        if isinstance(self._space, spaces.Dict):
            observation = {key: observation[key] for key in self._space.spaces}
        elif isinstance(self._space, spaces.Box):
            return np.asarray(observation).reshape(-1)
        return np.asarray(spaces.flatten(self._space, observation))

    def legal(self, observation: Any, info: Any) -> NDArray[np.bool_]:
        """[action], the actions that an agent may take; all of them without a mask."""
        mask = self._mask(observation, info)
        if mask is None:
            return np.ones(self.actions, bool)
        flags = legal_flags(mask, self.actions)
        return flags if flags.any() else np.ones(self.actions, bool)


class MultiAgentEnv:
    """Use `multi_agent_env`.

    Attributes:
        env: the multi-agent environment.
        agents: names of the agents, in EPyMARL's order.
        n_agents: number of them.
        episode_limit: steps of the longest episode.
        common_reward, is_mean: all agents have one reward; it is their mean, not their sum.
        live: [agent], agents that are live.
        rewards, terminations, truncations: [agent], of the last step.
        infos: of the last step, by name.
        episode: its number in the run; -1 where `reset` was given a seed of its own.
    """

    common_reward, is_mean = True, False

    def __init__(
        self,
        opened: Opened,
        role: str | None,
        others: Choices,
        *,
        time_limit: int | None,
        state: str | None,
        seed: int,
    ) -> None:
        self.env: Any = slim(opened.env)
        self._is_aec = opened.api == "aec"
        self._contract = declared_contract(None, opened) or Contract()
        possible = list(opened.env.possible_agents)
        self.agents = learners_of(possible, role, self._contract)
        rest = [agent for agent in possible if agent not in self.agents]
        require_policies(rest, others, self._contract)
        self.n_agents = len(self.agents)
        self.episode_limit = self._limit(time_limit)
        self._policies = joint_policy_of(others, opened.env, self._contract)
        self._seen = {a: LastSeen(self.env, self._contract, a) for a in self.agents}
        self._obs_size = max(one.length for one in self._seen.values())
        self._actions = max(one.actions for one in self._seen.values())
        self._has_state = self._own_state(state)
        self._run_seed, self._next = seed, 0
        self.episode = -1
        self._is_begun = False

    def _limit(self, time_limit: int | None) -> int:
        limit = self._contract.schedule.horizon if time_limit is None else time_limit
        if limit is None or (self._is_aec and time_limit is None) or limit < 1:
            raise SpecError(
                "the longest episode's number of steps isn't known",
                where="time_limit",
                expected="a number of steps; of turns in an AEC environment",
                actual=repr(time_limit),
                fix="time_limit=N, or schedule.horizon in the contract of a Parallel environment",
            )
        return limit

    def _own_state(self, state: str | None) -> bool:
        space = getattr(self.env.unwrapped, "state_space", None)
        if isinstance(space, spaces.Box) and state != "observations":
            self._state_size = int(np.prod(space.shape))
            return True
        if state == "state":
            raise SpecError(
                "the environment declares no state_space that is a Box",
                where="state",
                actual=repr(space),
                fix="state='observations'",
            )
        self._state_size = self.n_agents * self._obs_size
        return False

    # -- a run

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[list[NDArray[np.float32]], dict[str, Any]]:
        """Begins an episode; returns all agents' observations and an empty info.

        Args:
            seed: of this episode, for the environment and the other agents; None: the run's next.
            options: handed to the environment.
        """
        if seed is None:
            self.episode = self._next
            self._policies.begin(self._run_seed, self.episode)
            seed, self._next = episode_seed(self._run_seed, self._next), self._next + 1
        else:
            self.episode = -1
            self._policies.begin(seed, 0)  # the others' draws are another seed's too
        more = {} if options is None else {"options": dict(options)}
        out = self.env.reset(seed=seed, **more)
        self._steps = 0
        self._given: dict[Any, Any] = {}
        self.infos: dict[Any, Any] = {}
        self._ended: set[Any] = set()
        self._clear()
        if self._is_aec:
            self._turns()
        else:
            self._given, self.infos = dict(out[0]), dict(out[1])
        self._is_begun = bool(self.env.agents)
        self._look()
        return self.get_obs(), {}

    def step(
        self, actions: Sequence[int]
    ) -> tuple[list[NDArray[np.float32]], Any, bool, bool, dict[str, Any]]:
        """Steps all agents; actions of agents that aren't live are ignored.

        Args:
            actions: [agent], numbers from 0.
        Returns:
            Observations, the common reward or [agent] rewards, terminated (the last agent was),
            truncated (the whole episode was), an info of numbers.
        Raises:
            OrderError: no agent is live: `reset` comes first.
            ActionError: an action isn't available, or there isn't one for each agent.
        """
        chosen = self._chosen(actions)
        if self._steps:  # rewards before the first turn are returned with that turn's
            self._clear()
        self._steps += 1
        if self._is_aec:
            env = self.env
            env.step(chosen[env.agent_selection])
            self._book(env.rewards, env.terminations, env.truncations)
            self._turns()
        else:
            self._tick(chosen)
        is_over = not self.env.agents
        is_cut = not is_over and self._steps >= self.episode_limit
        was_live = self.live
        self._look()
        self._note_departures(was_live & ~self.live)
        if is_cut:  # agents that are live now, not those that were before the step
            self.truncations |= self.live
        self._is_begun = not (is_over or is_cut)
        terminated = is_over and not self._is_all_cut
        truncated = is_cut or (is_over and not terminated)
        return self.get_obs(), self._reward(), terminated, truncated, {"episode_limit": truncated}

    def _clear(self) -> None:
        self.rewards = np.zeros(self.n_agents)
        self.terminations = np.zeros(self.n_agents, bool)
        self.truncations = np.zeros(self.n_agents, bool)
        self._is_all_cut = True

    def _chosen(self, actions: Sequence[int]) -> dict[Any, Any]:
        if not self._is_begun:
            raise OrderError("no agent is live", where="step", fix="call reset() first")
        if len(actions) != self.n_agents:
            raise ActionError(
                "there isn't one action for each agent",
                where="actions",
                expected=str(self.n_agents),
                actual=str(len(actions)),
                fix="give a number for each of env.agents, in this order",
            )
        chosen = {}
        for i, agent in enumerate(self.agents):
            action = int(actions[i])
            if not 0 <= action < self._actions or not self._available[i][action]:
                raise ActionError(
                    "an action isn't available: the agent's mask forbids it",
                    where=f"agent {agent!r}",
                    expected=f"one of {np.flatnonzero(self._available[i]).tolist()}",
                    actual=str(action),
                    fix="take an action that get_avail_actions() gives",
                )
            chosen[agent] = self._seen[agent].start + action
        return chosen

    def _tick(self, chosen: Mapping[Any, Any]) -> None:
        acts = {
            a: chosen[a]
            if a in chosen
            else self._policies.act(a, self._given[a], self.infos.get(a, {}))
            for a in self.env.agents
        }
        self._given, paid, terms, truncs, self.infos = self.env.step(acts)
        self._book(paid, terms, truncs)

    def _book(self, paid: Any, terms: Any, truncs: Any) -> None:
        """Adds rewards; ends are noted once, though an AEC environment shows them longer."""
        ended = [a for a in terms if (terms[a] or truncs[a]) and a not in self._ended]
        self._ended.update(ended)
        self._ended -= {a for a in terms if not (terms[a] or truncs[a])}  # it joined again
        if ended:
            self._is_all_cut = not any(terms[a] for a in ended)
        for i, agent in enumerate(self.agents):
            self.rewards[i] += float(paid.get(agent, 0.0))
            if agent in ended:
                self.terminations[i], self.truncations[i] = terms[agent], truncs[agent]

    def _note_departures(self, departed: Any) -> None:
        """Notes agents that left without an ending as terminated."""
        left = [i for i in departed.nonzero()[0] if self.agents[i] not in self._ended]
        self._ended.update(self.agents[i] for i in left)
        if left:
            self.terminations[left] = True
            self._is_all_cut = False

    def _turns(self) -> None:
        """Plays the turns of ended agents (None) and of other agents, up to a learner's."""
        env = self.env
        while env.agents:
            agent = env.agent_selection
            observation, _, terminated, truncated, info = env.last()
            self.infos[agent] = info
            if terminated or truncated:
                self._given[agent] = observation
                env.step(None)
                self._book(env.rewards, env.terminations, env.truncations)
                continue
            if agent in self._seen:
                break
            env.step(self._policies.act(agent, observation, info))
            self._book(env.rewards, env.terminations, env.truncations)
        self._given |= {a: env.observe(a) for a in self.agents if a in env.agents}

    # -- observations

    def _look(self) -> None:
        """Keeps all agents' observations and available actions, as they stand now."""
        env, here = self.env, set(self.env.agents)
        if self._is_aec:
            here -= {a for a in here if env.terminations[a] or env.truncations[a]}
        turn = {env.agent_selection} if self._is_aec and here else here
        self.live = np.array([agent in here for agent in self.agents])
        self._obs, self._available = [], []
        for agent in self.agents:
            seen = self._seen[agent]
            observation, info = self._given.get(agent), self.infos.get(agent, {})
            row = np.zeros(self._obs_size, np.float32)
            if observation is not None:
                row[: seen.length] = seen.flat(observation)
            flags = np.zeros(self._actions, np.int64)
            if agent in turn:
                flags[: seen.actions] = seen.legal(observation, info)
            else:
                flags[seen.noop] = 1
            self._obs.append(row)
            self._available.append(flags)
        # the last observation of an agent that ended in this step is shown once
        stays = () if self._is_aec else here
        self._given = {a: one for a, one in self._given.items() if a in stays}

    def _reward(self) -> Any:
        if not self.common_reward:
            return self.rewards.tolist()
        return float(self.rewards.mean() if self.is_mean else self.rewards.sum())

    def get_obs(self) -> list[NDArray[np.float32]]:
        """All agents' observations, [agent] of [observation]."""
        return [row.copy() for row in self._obs]

    def get_obs_agent(self, agent_id: int) -> NDArray[np.float32]:
        """Observation of one agent."""
        return self._obs[agent_id].copy()

    def get_obs_size(self) -> int:
        """Length of the longest observation."""
        return self._obs_size

    def get_state(self) -> NDArray[np.float32]:
        """The environment's `state()` as a flat vector, or all observations in a row."""
        if self._has_state:
            return np.asarray(self.env.state(), np.float32).reshape(-1)
        return np.concatenate(self._obs)

    def get_state_size(self) -> int:
        """Length of the state."""
        return self._state_size

    def get_avail_actions(self) -> list[list[int]]:
        """1 for each action that an agent may take now, [agent] of [action]."""
        return [flags.tolist() for flags in self._available]

    def get_avail_agent_actions(self, agent_id: int) -> list[int]:
        """1 for each action that one agent may take now."""
        return self.get_avail_actions()[agent_id]

    def get_total_actions(self) -> int:
        """Number of actions of the agent that has most."""
        return self._actions

    def get_env_info(self) -> dict[str, Any]:
        """Sizes, for EPyMARL's schemes."""
        return {
            "state_shape": self.get_state_size(),
            "obs_shape": self.get_obs_size(),
            "n_actions": self.get_total_actions(),
            "n_agents": self.n_agents,
            "episode_limit": self.episode_limit,
        }

    def get_stats(self) -> dict[str, Any]:
        """Returns no statistics: evidence (`gk.rollout`, `gk.record`) has them all."""
        return {}

    def seed(self, seed: int | None = None) -> int:
        """Sets the seed of the run from the next reset on; returns the one that holds."""
        if seed is not None:
            self._run_seed, self._next = seed, 0
        return self._run_seed

    def render(self) -> Any:
        """Renders the environment."""
        return self.env.render()

    def save_replay(self) -> None:
        """Refused: `gk.record` keeps episodes, with frames where asked.

        Raises:
            SpecError: always.
        """
        raise SpecError(
            "replays aren't saved here", where="save_replay", fix="gk.rollout(spec, out='runs/x')"
        )

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()


def multi_agent_env(
    spec: object,
    *,
    role: str | None = None,
    others: Choices = None,
    common_reward: str | None = "sum",
    time_limit: int | None = None,
    state: str | None = None,
    check: str | None = "quick",
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
) -> MultiAgentEnv:
    """A multi-agent environment with EPyMARL's methods, as its runners and learners call them.

    | | |
    |---|---|
    | kept | the order of agents, that of `possible_agents`; every agent's own reward with `common_reward=None`; masks as available actions; `state()`; truncation apart from termination, for all in `truncated` and `info["episode_limit"]`, for each in `terminations` and `truncations`; infos of agents in `infos`; seeds: without one of its own, reset k plays episode k of run `seed`, the same as `gk.rollout`, and `reset(seed=s)` is the environment's own, with the others' draws from s |
    | changed | observations are flat float32 vectors without their mask (parts of a Discrete are one-hot, as Gymnasium flattens them; no name or role of an agent is added), padded with zeros to the longest, actions counted from 0 and padded to the most, with those that an agent hasn't never available; whoever is not there (ended, or not yet come) sees zeros and has one action only, its role's noop by the contract, else 0, which is passed over; with `common_reward` the reward is the sum or the mean over all agents. In an AEC environment a step is one turn: the others have that one action, and see what they would be shown. Without a `state_space`, or with `state="observations"`, the state is everybody's observations |
    | lost | who ended when, to learners: EPyMARL has one end for all, when the last agent has ended. Parts of rewards by term |
    | refused | actions that aren't Discrete (give the environment some), observations without a fixed length, an environment that never says when it is over (`time_limit=`), others without a policy (`others=`), an environment that breaks the contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        role: only its agents are the environment's; None: all agents.
        others: policies of the others, one for all or by agent or role.
        common_reward: `sum` or `mean` of all agents' rewards; None: a reward for each agent.
        time_limit: steps after which an episode is cut, and what EPyMARL reserves memory for; None:
            the contract's horizon.
        state: `state`: the environment's own; `observations`; None: its own where it has one.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the run.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    if common_reward is not None:
        what = "there is no such common_reward (None: each agent's own)"
        check_choice(common_reward, ("sum", "mean"), what, where="common_reward")
    if state is not None:
        check_choice(state, ("state", "observations"), "there is no such state", where="state")
    checked(spec, check, env_kwargs=env_kwargs)
    opened = open_env(spec, **dict(env_kwargs or {}))
    with closed_on_error(opened.env):
        env = MultiAgentEnv(opened, role, others, time_limit=time_limit, state=state, seed=seed)
    env.common_reward, env.is_mean = common_reward is not None, common_reward == "mean"
    return env


def gymma(
    key: str,
    time_limit: int | None = None,
    pretrained_wrapper: None = None,
    seed: int = 0,
    common_reward: bool = True,
    reward_scalarisation: str = "sum",
    check: str | None = "quick",
    **env_kwargs: Any,
) -> MultiAgentEnv:
    """`multi_agent_env` with the arguments that EPyMARL hands to an entry of its REGISTRY.

    `envs.REGISTRY["gamekeeper"] = gymma`, then `env_args.key=warehouse`; `env_args.check` is that
    of `multi_agent_env`, what else stands in `env_args` goes to the environment.

    Raises:
        SpecError: a `pretrained_wrapper` is asked for: `multi_agent_env` has `others`.
        ContractError: see there.
    """
    if pretrained_wrapper is not None:
        raise SpecError(
            "pretrained wrappers are EPyMARL's own",
            where="pretrained_wrapper",
            actual=repr(pretrained_wrapper),
            fix="multi_agent_env(spec, role=..., others=...)",
        )
    return multi_agent_env(
        key,
        time_limit=time_limit,
        seed=seed,
        check=check,
        env_kwargs=env_kwargs,
        common_reward=reward_scalarisation if common_reward else None,
    )
