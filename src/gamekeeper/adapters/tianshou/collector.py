"""A collector of decisions: each agent's own, with all that they brought it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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

from gamekeeper.adapters.tianshou.vector_env import AgentsVectorEnv
from gamekeeper.errors import SpecError

ROWS: int = 10_000
"""Decisions that a seat's part of the usual buffer holds."""


class Collector(BaseCollector):
    """Collects decisions of every agent into a sub-buffer of its own; Tianshou's trainers take it.

    A decision is finished when its agent acts again or ends: its reward is all that the agent was
    paid meanwhile, `obs_next` what it saw then. One that is open as an update comes is finished in
    the next collection. Where everybody acts in every step, this is what Tianshou's own does.

    Args:
        policy: a policy or an algorithm; of many, where the environment has several `agents`.
        env: of `vector_env`.
        buffer: with a sub-buffer for each of `len(env)` seats; None: a VectorReplayBuffer.
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
                "this collector takes decisions of agents", where="env",
                expected="what vector_env returned", seen=type(env).__qualname__,
                mend="gamekeeper.adapters.tianshou.vector_env(spec, num_envs)",
            )  # fmt: skip
        if buffer is None:
            buffer = VectorReplayBuffer(ROWS * len(env), len(env))
        if not isinstance(buffer, ReplayBufferManager) or buffer.buffer_num < len(env):
            raise SpecError(
                "each agent of each copy has a part of the buffer", where="buffer",
                expected=f"{len(env)} parts", seen=type(buffer).__qualname__,
                mend=f"VectorReplayBuffer(size, {len(env)})",
            )  # fmt: skip
        super().__init__(
            policy, env, buffer, exploration_noise=exploration_noise,
            raise_on_nan_in_buffer=raise_on_nan_in_buffer, collect_stats_class=Stats,
        )  # fmt: skip
        self._is_begun = False

    def reset_env(self, gym_reset_kwargs: dict[str, Any] | None = None) -> tuple[Any, Any]:
        """Begins a run; what was open is forgotten."""
        given: tuple[Any, Any] = super().reset_env(gym_reset_kwargs)
        self._open = Open(len(self.env))
        seats = self.env.seats
        self._returns = np.zeros(seats.acting.shape)
        self._lengths = np.zeros(seats.num_envs, int)
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
            raise SpecError("nothing has begun", where="collect", mend="collector.reset()")
        stats = self.collect_stats_class()
        episodes: dict[int, tuple[Any, int]] = {}
        wanted = np.inf if n_episode is None else self._first(n_episode)
        while len(episodes) < (n_episode or np.inf) and stats.n_collected_steps < (
            n_step or np.inf
        ):
            stats.n_collected_steps += self._step(episodes, wanted, random=random)
        stats.n_collected_episodes = len(episodes)
        told = [episodes[number] for number in sorted(episodes)]
        stats.lens = np.array([length for _, length in told], int)
        stats.returns = np.array([paid for paid, _ in told], float)
        if self.env.seats.acting.shape[1] == 1:
            stats.returns = stats.returns.reshape(-1)
        self.collect_step += stats.n_collected_steps
        self.collect_episode += stats.n_collected_episodes
        if n_episode:
            self.reset_env(gym_reset_kwargs)
        return stats

    def _first(self, count: int) -> int:
        """The number below which so many episodes lie that aren't over yet: only they count."""
        copies, begun = self.env.seats.num_envs, self.env.seats.episode
        ahead = np.sort((begun[:, None] + copies * np.arange(count)).reshape(-1))
        return int(ahead[count - 1]) + 1

    def _validate_n_step_n_episode(self, n_episode: int | None, n_step: int | None) -> None:
        """One of them; any number will do, as copies are no seats."""
        if bool(n_step) == bool(n_episode):
            raise SpecError(
                "collect steps or episodes", where="collect", expected="n_step or n_episode",
                seen=f"n_step={n_step}, n_episode={n_episode}",
            )  # fmt: skip

    def _step(self, episodes: dict[int, Any], wanted: float, *, random: bool) -> int:
        """One step of all copies; how many decisions it finished."""
        env, seats = self.env, self.env.seats
        counts = np.repeat(seats.episode < wanted, seats.acting.shape[1])
        acting = seats.acting.reshape(-1)
        deciding = acting & counts
        rows = env.rows(seats.obs, deciding)
        acts, played = self._chosen(rows, deciding, random=random)
        self._open.begin(deciding, rows, acts)
        whole = self._filler(played)
        whole[deciding] = played
        came = seats.step(whole.reshape(*seats.acting.shape, *whole.shape[1:]))
        self._open.paid += came.rewards.reshape(-1)
        self._returns += came.rewards
        self._lengths += 1
        for copy in np.flatnonzero(came.over):
            if came.episode[copy] < wanted:
                episodes[int(came.episode[copy])] = self._returns[copy].copy(), self._lengths[copy]
            self._returns[copy] = self._lengths[copy] = 0
        ended = [flags.reshape(-1) for flags in (came.terminated, came.truncated)]
        done = self._open.is_open & (ended[0] | ended[1] | seats.acting.reshape(-1))
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
            obs=rows, act=acts, rew=paid, terminated=ended[0][done], truncated=ended[1][done],
            obs_next=after, info=Batch(),
        )  # fmt: skip
        self.buffer.add(batch, buffer_ids=np.flatnonzero(done))

    # -- what agents do

    def _chosen(
        self, rows: Any, deciding: NDArray[np.bool_], *, random: bool
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """What is done, as the policy has it and as the environment takes it."""
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
                "a policy with a hidden state isn't taken along from step to step",
                where="policy", seen=type(self.policy).__qualname__,
                mend="stack what was seen, in the environment, and take a feed-forward network",
            )  # fmt: skip
        acts = to_numpy(out.act)
        if self.exploration_noise:
            acts = self.policy.add_exploration_noise(acts, given)
        return acts, np.asarray(self.policy.map_action(acts))

    def _drawn(self, rows: Any, count: int) -> NDArray[Any]:
        """Any legal actions."""
        space, seats = self.env.action_space, self.env.seats
        if not seats.forms.actions:
            return np.array([space.sample() for _ in range(count)]).reshape(count, *space.shape)
        masks = rows.mask if seats.masks is not None else np.ones((count, seats.forms.actions))
        # Tianshou's buffers have the only generator there is, with a seed of its own.
        worth: NDArray[Any] = self.buffer._random_state.random(np.shape(masks)) * masks
        return np.asarray(worth.argmax(-1))

    def _filler(self, played: NDArray[Any]) -> NDArray[Any]:
        """An action for everybody that the environment takes, whoever acts."""
        seats = self.env.seats
        if not seats.forms.actions:
            return np.zeros((len(self.env), *played.shape[1:]), played.dtype)
        if seats.masks is None:
            return np.zeros(len(self.env), np.int64)
        found: NDArray[Any] = seats.masks.reshape(len(self.env), -1).argmax(-1)
        return found


@dataclass(kw_only=True)
class Stats(CollectStats):
    """Returns are [episode, agent]; steps are decisions, `lens` those of the copies."""

    def refresh_return_stats(self) -> None:
        """Mean and the like over all of them."""
        found = self.returns.reshape(-1)
        self.returns_stat = SequenceSummaryStats.from_sequence(found) if len(found) else None


class Open:
    """Decisions that aren't finished.

    Attributes:
        is_open: [seat].
        paid: [seat], since its decision.
    """

    def __init__(self, seats: int) -> None:
        """Nobody has decided anything."""
        self.is_open, self.paid = np.zeros(seats, bool), np.zeros(seats)
        self._rows: Any = None
        self._acts: Any = None

    def begin(self, deciding: NDArray[np.bool_], rows: Any, acts: NDArray[Any]) -> None:
        """Some decide."""
        if not deciding.any():
            return
        if self._rows is None:
            self._rows, self._acts = (_room(one, len(self.paid)) for one in (rows, acts))
        self.is_open |= deciding
        self.paid[deciding] = 0.0
        _put(self._rows, deciding, rows)
        self._acts[deciding] = acts

    def end(self, done: NDArray[np.bool_]) -> tuple[Any, NDArray[Any], NDArray[np.float64]]:
        """Decisions of some, and what they were paid."""
        self.is_open &= ~done
        return _taken(self._rows, done), self._acts[done], self.paid[done]


def _room(rows: Any, count: int) -> Any:
    """Zeros in the form of rows, for so many."""
    if isinstance(rows, Batch):
        return {key: _room(rows[key], count) for key in rows.get_keys()}
    return np.zeros((count, *rows.shape[1:]), rows.dtype)


def _put(whole: Any, where: NDArray[np.bool_], rows: Any) -> None:
    if isinstance(whole, dict):
        for key, part in whole.items():
            _put(part, where, rows[key])
    else:
        whole[where] = rows


def _taken(whole: Any, where: NDArray[np.bool_]) -> Any:
    if isinstance(whole, dict):
        return Batch({key: _taken(part, where) for key, part in whole.items()})
    return whole[where]


def _has_values(state: Any) -> bool:
    """Whether a state that a policy gave holds anything: Tianshou's have empty Batches in them."""
    if isinstance(state, Batch):
        return any(_has_values(state[key]) for key in state.get_keys())
    if isinstance(state, dict):
        return any(_has_values(part) for part in state.values())
    return state is not None
