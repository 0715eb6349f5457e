"""Vector environment and collector for Tianshou's algorithms, one agent's or many agents'.

The collector finishes each agent's own decisions, with all the rewards that they brought it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from tianshou.data import (
    Batch,
    ReplayBufferManager,
    SequenceSummaryStats,
    VectorReplayBuffer,
    to_numpy,
)
from tianshou.data.collector import BaseCollector, CollectStats

from gamekeeper.adapters.requirements import checked
from gamekeeper.adapters.slot_views import put
from gamekeeper.adapters.tianshou.tianshou_agents import TianshouAgents
from gamekeeper.errors import SpecError, check_choice
from gamekeeper.interface.joint_policy import Choices
from gamekeeper.vector.vector_form import changed

ROWS: int = 10_000
"""Number of decisions that a slot's part of the default buffer holds."""


class Collector(BaseCollector):
    """Collects decisions of every agent into a sub-buffer of its own; Tianshou's trainers take it.

    A decision is finished when its agent acts again or ends: its reward is all that the agent was
    paid meanwhile, `obs_next` what it saw then. One that is open as an update comes is finished in
    the next collection. Where everybody acts in every step, this is what Tianshou's own does.

    Args:
        policy: a policy or an algorithm; of many, where the environment has several `agents`.
        env: of `vector_env`.
        buffer: with a sub-buffer for each of `len(env)` slots; None: a VectorReplayBuffer.
        exploration_noise: asks the policy for its noise.
        raise_on_nan_in_buffer: looks for NaN after each collection.
    Raises:
        SpecError: the environment isn't of `vector_env`, or the buffer has too few parts.
    """

    def __init__(
        self,
        policy: Any,
        env: AgentsVectorEnv,
        buffer: Any = None,
        *,
        exploration_noise: bool = False,
        raise_on_nan_in_buffer: bool = True,
    ) -> None:
        if not isinstance(env, AgentsVectorEnv):
            raise SpecError(
                "the collector needs an environment of vector_env()",
                where="env",
                expected="what vector_env returned",
                actual=type(env).__qualname__,
                fix="gamekeeper.adapters.tianshou.vector_env(spec, num_envs)",
            )
        if buffer is None:
            buffer = VectorReplayBuffer(ROWS * len(env), len(env))
        if not isinstance(buffer, ReplayBufferManager) or buffer.buffer_num < len(env):
            raise SpecError(
                "each agent of each copy has a part of the buffer",
                where="buffer",
                expected=f"{len(env)} parts",
                actual=type(buffer).__qualname__,
                fix=f"VectorReplayBuffer(size, {len(env)})",
            )
        super().__init__(
            policy,
            env,
            buffer,
            exploration_noise=exploration_noise,
            raise_on_nan_in_buffer=raise_on_nan_in_buffer,
            collect_stats_class=Stats,
        )
        self._is_begun = False

    def reset_env(self, gym_reset_kwargs: dict[str, Any] | None = None) -> tuple[Any, Any]:
        """Begins a run; open decisions are dropped."""
        given: tuple[Any, Any] = super().reset_env(gym_reset_kwargs)
        self._open = Open(len(self.env))
        slots = self.env.slots
        self._returns = np.zeros(slots.acting.shape)
        self._lengths = np.zeros(slots.num_envs, int)
        self._is_begun = True
        return given

    def _collect(
        self,
        n_step: int | None = None,
        n_episode: int | None = None,
        random: bool = False,
        render: float | None = None,
        gym_reset_kwargs: dict[str, Any] | None = None,
    ) -> CollectStats:
        if not self._is_begun:
            raise SpecError("the collector was not reset", where="collect", fix="collector.reset()")
        stats = self.collect_stats_class()
        episodes: dict[int, tuple[Any, int]] = {}
        wanted = np.inf if n_episode is None else self._first(n_episode)
        while len(episodes) < (n_episode or np.inf) and stats.n_collected_steps < (
            n_step or np.inf
        ):
            stats.n_collected_steps += self._step(episodes, wanted, random=random)
        stats.n_collected_episodes = len(episodes)
        finished = [episodes[number] for number in sorted(episodes)]
        stats.lens = np.array([length for _, length in finished], int)
        stats.returns = np.array([paid for paid, _ in finished], float)
        if self.env.slots.acting.shape[1] == 1:
            stats.returns = stats.returns.reshape(-1)
        self.collect_step += stats.n_collected_steps
        self.collect_episode += stats.n_collected_episodes
        if n_episode:
            self.reset_env(gym_reset_kwargs)
        return stats

    def _first(self, count: int) -> int:
        """Returns the number below which so many unfinished episodes lie: only they count."""
        num_envs, begun = self.env.slots.num_envs, self.env.slots.episode
        ahead = np.sort((begun[:, None] + num_envs * np.arange(count)).reshape(-1))
        return int(ahead[count - 1]) + 1

    def _validate_n_step_n_episode(self, n_episode: int | None, n_step: int | None) -> None:
        """Requires one of them; any number will do, as sub-environments aren't slots."""
        if bool(n_step) == bool(n_episode):
            raise SpecError(
                "collect steps or episodes",
                where="collect",
                expected="n_step or n_episode",
                actual=f"n_step={n_step}, n_episode={n_episode}",
                fix="give one of n_step and n_episode",
            )

    def _step(self, episodes: dict[int, Any], wanted: float, *, random: bool) -> int:
        """Steps all sub-environments; returns the number of decisions that this finished."""
        env, slots = self.env, self.env.slots
        counts = np.repeat(slots.episode < wanted, slots.acting.shape[1])
        acting = slots.acting.reshape(-1)
        deciding = acting & counts
        rows = env.rows(slots.obs, deciding)
        acts, played = self._chosen(rows, deciding, random=random)
        self._open.begin(deciding, rows, acts)
        whole = self._filler(played)
        whole[deciding] = played
        came = slots.step(whole.reshape(*slots.acting.shape, *whole.shape[1:]))
        self._open.paid += came.rewards.reshape(-1)
        self._returns += came.rewards
        self._lengths += 1
        for copy in np.flatnonzero(came.over):
            if came.episode[copy] < wanted:
                episodes[int(came.episode[copy])] = self._returns[copy].copy(), self._lengths[copy]
            self._returns[copy] = self._lengths[copy] = 0
        ended = [flags.reshape(-1) for flags in (came.terminated, came.truncated)]
        done = self._open.is_open & (ended[0] | ended[1] | slots.acting.reshape(-1))
        if not done.any():
            return 0
        self._add(done, ended, env.rows(came.after, done, ended=ended[0] | ended[1]))
        return int(done.sum())

    def _add(self, done: NDArray[np.bool_], ended: list[Any], after: Any) -> None:
        rows, acts, paid = self._open.end(done)
        if self.env.is_multi:  # the multi-agent algorithms look for theirs in a column of its own
            wide = np.zeros((len(paid), len(self.env.agents)))
            wide[np.arange(len(paid)), [self.env.agent_idx[name] for name in rows.agent_id]] = paid
            paid = wide
        batch = Batch(
            obs=rows,
            act=acts,
            rew=paid,
            terminated=ended[0][done],
            truncated=ended[1][done],
            obs_next=after,
            info=Batch(),
        )
        self.buffer.add(batch, buffer_ids=np.flatnonzero(done))

    # -- what agents do

    def _chosen(
        self, rows: Any, deciding: NDArray[np.bool_], *, random: bool
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Returns actions as the policy has them, and as the environment takes them."""
        if random or not deciding.any():
            played = self._drawn(rows, int(deciding.sum()))
            return np.asarray(self.policy.map_action_inverse(played)), played
        # Tianshou tells only the policy of all that it is learning, which its parts must know too:
        # without it they don't explore.
        for part in getattr(self.policy, "policies", {}).values():
            part.is_within_training_step = self.policy.is_within_training_step
        # An empty `obs_next` stands there for MultiAgentPolicy, which looks into it.
        given = Batch(obs=rows, info=Batch(), obs_next=Batch())
        with torch.no_grad():
            out = self.policy(given)
        if _has_values(out.get("state")):
            raise SpecError(
                "the hidden state of a policy isn't kept from step to step",
                where="policy",
                actual=type(self.policy).__qualname__,
                fix="stack past observations in the environment, and use a feed-forward network",
            )
        acts = to_numpy(out.act)
        if self.exploration_noise:
            acts = self.policy.add_exploration_noise(acts, given)
        return acts, np.asarray(self.policy.map_action(acts))

    def _drawn(self, rows: Any, count: int) -> NDArray[Any]:
        space, slots = self.env.action_space, self.env.slots
        if not slots.forms.actions:
            return np.array([space.sample() for _ in range(count)]).reshape(count, *space.shape)
        masks = rows.mask if slots.masks is not None else np.ones((count, slots.forms.actions))
        # Tianshou's buffers have the only generator there is, with a seed of its own.
        worth: NDArray[Any] = self.buffer._random_state.random(np.shape(masks)) * masks
        return np.asarray(worth.argmax(-1))

    def _filler(self, played: NDArray[Any]) -> NDArray[Any]:
        """Returns an action of every slot that the environment takes, whichever slots act."""
        slots = self.env.slots
        if not slots.forms.actions:
            return np.zeros((len(self.env), *played.shape[1:]), played.dtype)
        if slots.masks is None:
            return np.zeros(len(self.env), np.int64)
        return np.asarray(slots.masks.reshape(len(self.env), -1).argmax(-1))


@dataclass(kw_only=True)
class Stats(CollectStats):
    """Returns are [episode, agent]; steps are decisions, `lens` those of the copies."""

    def refresh_return_stats(self) -> None:
        """Summarizes the returns of all agents together."""
        found = self.returns.reshape(-1)
        self.returns_stat = SequenceSummaryStats.from_sequence(found) if len(found) else None


class Open:
    """Decisions that aren't finished.

    Attributes:
        is_open: [slot], slots that have one.
        paid: [slot], reward since the decision.
    """

    def __init__(self, slots: int) -> None:
        self.is_open, self.paid = np.zeros(slots, bool), np.zeros(slots)
        self._rows: Any = None
        self._acts: Any = None

    def begin(self, deciding: NDArray[np.bool_], rows: Any, acts: NDArray[Any]) -> None:
        """Begins the decisions of some slots."""
        if not deciding.any():
            return
        if self._rows is None:
            self._rows, self._acts = (_room(one, len(self.paid)) for one in (rows, acts))
        self.is_open |= deciding
        self.paid[deciding] = 0.0
        put(self._rows, deciding, rows)
        self._acts[deciding] = acts

    def end(self, done: NDArray[np.bool_]) -> tuple[Any, NDArray[Any], NDArray[np.float64]]:
        """Finishes the decisions of some slots; returns their rows, actions and rewards."""
        self.is_open &= ~done
        rows = changed(self._rows, itemgetter(done))
        rows = Batch(rows) if isinstance(rows, dict) else rows
        return rows, self._acts[done], self.paid[done]


def _room(rows: Any, count: int) -> Any:
    """Returns zeros in the form of rows, so many of them."""
    if isinstance(rows, Batch):
        return {key: _room(rows[key], count) for key in rows.get_keys()}
    return np.zeros((count, *rows.shape[1:]), rows.dtype)


def _has_values(state: Any) -> bool:
    """True if the state that a policy returned isn't empty; Tianshou's hold empty Batches."""
    if isinstance(state, Batch):
        return any(_has_values(state[key]) for key in state.get_keys())
    if isinstance(state, dict):
        return any(_has_values(part) for part in state.values())
    return state is not None


SHARES: Final = ("one", "role", "agent")


def vector_env(
    spec: object,
    num_envs: int,
    *,
    role: str | None = None,
    others: Choices = None,
    algorithms: str = "one",
    repeats: bool = False,
    check: str | None = "quick",
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    **options: Any,
) -> AgentsVectorEnv:
    """Copies of a multi-agent environment for Tianshou, Parallel or AEC; see `Collector`.

    With `algorithms="one"` all learning agents share any algorithm of Tianshou's; with "role" or
    "agent" each of `env.agents` has its own, for `MultiAgentOnPolicyAlgorithm(algorithms=[...],
    env=env)` and its off-policy sister.

    | | |
    |---|---|
    | kept | every agent's own decisions: what it saw, did, was paid until it acted again, and saw then, its end, truncated apart from terminated (Tianshou bootstraps from `obs_next`); masks in `obs.mask`, whose decision it is in `obs.agent_id` (the name in `env.agents`); an agent that comes late or ends early has a row for each decision and no other; seeds: copy e plays the episodes e, e + num_envs, ... of run `seed`, the same as `gk.rollout` |
    | changed | a sub-buffer holds one agent of one copy, not a copy; steps are decisions, episodes those of copies, their `lens` the steps of the copy (ticks, or everybody's turns), returns are [episode, agent]; collecting n episodes takes the first n of the run, however long each is. Roles with different spaces are padded: flat observations with zeros, Discrete actions with masked ones. Actions count from 0. A Dict observation loses its `action_mask`; of one other part only that part is left. A reset without a seed begins the next run, `seed` + 1, + 2, ...; with `repeats=True` the same one |
    | lost | infos but for the mask; `state()`; what was paid before an agent's first decision; Tianshou's hooks |
    | refused | Tianshou's own Collector (it credits a reward to who acted last, whoever earned it: take ours), policies with a hidden state, Tuple observations, actions in parts (Dict, Tuple), masks of actions that aren't Discrete, roles with spaces that can't be padded (`role=`), others without a policy (`others=`), an environment that breaks the contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        num_envs: how many copies.
        role: the role, or the one agent, that learns; None: everybody.
        others: policies of who doesn't learn, one for all or by agent or role.
        algorithms: how many there are: `one`, one for each `role`, one for each `agent`.
        repeats: each reset begins the same run, for tests that play the same episodes.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the first run.
        env_kwargs: handed to the environment.
        options: of `gk.vector.make`: `engine`, `workers`, `threads`.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    check_choice(algorithms, SHARES, "algorithms= has no such value", where="algorithms")
    checked(spec, check, env_kwargs=env_kwargs)
    slots = TianshouAgents(
        spec, num_envs, role=role, others=others, seed=seed, env_kwargs=env_kwargs, **options
    )
    return AgentsVectorEnv(slots, algorithms, repeats=repeats)


class AgentsVectorEnv:
    """Use `vector_env`.

    Attributes:
        slots: the learning agents of all sub-environments.
        agents: names of the algorithms' agents: "all", roles, or agents.
        agent_idx: their numbers.
        observation_space, action_space: of every learner.
        is_multi: there is an algorithm for each of `agents`.
    """

    is_async = False

    def __init__(self, slots: TianshouAgents, algorithms: str, *, repeats: bool) -> None:
        self.slots, self.is_multi, self._repeats = slots, algorithms != "one", repeats
        named = {
            "one": ["all"] * len(slots.learners),
            "role": [slots.role_of(agent) for agent in slots.learners],
            "agent": [str(agent) for agent in slots.learners],
        }[algorithms]
        self.agents = list(dict.fromkeys(named))
        self.agent_idx = {name: i for i, name in enumerate(self.agents)}
        self.named = np.array(named)
        self.observation_space = slots.forms.observation_space
        self.action_space = slots.forms.action_space
        self.env_num = slots.acting.size
        self._next = slots.seed

    def __len__(self) -> int:
        """Number of slots: learners of all sub-environments."""
        return self.env_num

    def reset(self, *, seed: int | None = None) -> tuple[Any, Any]:
        """Begins a run; returns each slot's observation and an empty info."""
        if seed is None:
            seed, self._next = self._next, self._next + (not self._repeats)
        self.slots.reset(seed)
        return self.rows(self.slots.obs, np.ones(self.env_num, bool)), np.array([{}] * self.env_num)

    def rows(self, obs: Any, which: Any, *, ended: Any = False) -> Any:
        """Returns observations of some slots, as Tianshou's policies take them.

        Args:
            obs: [env, agent, ...].
            which: [slot] bool.
            ended: [slot] bool; their masks are those of the next episode, so all is allowed.
        """
        count = self.env_num
        seen = changed(obs, lambda part: part.reshape(count, *part.shape[2:])[which])
        seen = Batch(seen) if isinstance(seen, dict) else seen
        masks = self.slots.masks
        if masks is None and not self.is_multi:
            return seen
        found = {"obs": seen, "agent_id": np.tile(self.named, self.slots.num_envs)[which]}
        if masks is not None:
            found["mask"] = (masks.reshape(self.env_num, -1) | np.atleast_1d(ended)[:, None])[which]
        return Batch(found)

    def step(self, action: Any, id: Any = None) -> Any:  # Tianshou's names
        """Refused: only some slots decide in a step, which Tianshou's own Collector can't know.

        Raises:
            SpecError: always.
        """
        raise SpecError(
            "Tianshou's Collector takes every slot for an environment of its own",
            where="step",
            fix="gamekeeper.adapters.tianshou.Collector(algorithm, env, buffer)",
        )

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Sets the seed of the run that the next reset begins."""
        if seed is not None:
            self._next = seed
        return [seed] * self.env_num

    def render(self, **kwargs: Any) -> list[Any]:
        """Returns no pictures: `gk.record(..., frames=True)` takes them."""
        return []

    def close(self) -> None:
        """Closes every sub-environment."""
        self.slots.close()
