"""A slot for each learning agent of each copy; the other agents follow given policies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.slots.actions import TickActions, TurnActions
from gamekeeper.adapters.slots.learners import casts_of_others, find_learners
from gamekeeper.adapters.slots.views import TickView, TurnView
from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.game.casting.cast import Choices
from gamekeeper.vector.front import make

NOBODY: Final = np.zeros(0, np.intp)


@dataclass(frozen=True, slots=True)
class Step:
    """What one step gave each slot; arrays are [slot, ...].

    Attributes:
        obs: what each slot is given next; zeros where nobody is, the last known of who waits.
        rewards: what each was paid in this step.
        terminated, truncated: who ended in it; who left without an ending counts as terminated.
        final: by slot that ended, its last observation; of who ends in an AEC copy that goes on
            without it, what it was shown before its last turn.
        lengths, returns: by slot that ended, its own decisions and their sum in the episode.
    """

    obs: Any
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    final: Mapping[int, Any]
    lengths: Mapping[int, int]
    returns: Mapping[int, float]


class Slots:
    """Learning agents of many copies, each in a slot.

    Slot e * A + a is learner a of copy e.

    Args:
        spec, num_envs, seed: as `gk.vector.make` has them.
        role: only its agents, or the one agent of that name, learn; None: all do.
        others: policies of who doesn't learn, by agent or role; of nobody else. An object is one
            player for all copies, a class or a name makes one for each.
        options: of `gk.vector.make`: engine, workers, threads, env_kwargs, contract, timeout_s.

    Attributes:
        venv: the vector environment; its arrays are overwritten by every step.
        group: whose spaces the learners have.
        learners: names of the learning agents, A of them.
        count: how many slots there are.
        observation_space, action_space: of a slot.
        acted: [slot], who acted in the last step.
        acting: [slot], who acts in the next one.
        masks: [slot, action], what each may do; ones where it doesn't matter.
        seed: of the run.
    Raises:
        SpecError: the learners differ in their spaces, or somebody has no policy.
    """

    def __init__(
        self,
        spec: object,
        num_envs: int,
        *,
        role: str | None = None,
        others: Choices = None,
        seed: int = 0,
        **options: Any,
    ) -> None:
        self.venv = venv = make(
            spec, num_envs, seed=seed, infos=others is not None, copy=False, **options
        )
        self.seed = seed
        try:
            self._contract = venv.seen.contract or Contract()
            learners = find_learners(venv.groups, role, self.role_of)
            self._casts = casts_of_others(
                spec, dict(options.get("env_kwargs") or {}), others, learners, self.role_of,
                contract=self._contract, num_envs=num_envs,
            )  # fmt: skip
        except BaseException:
            venv.close()
            raise
        self.group, self.learners = learners.group, list(learners.agents)
        is_aec = venv.api == "aec"
        actions, view = (TurnActions, TurnView) if is_aec else (TickActions, TickView)
        self._actions: Any = actions(learners, venv.groups, self._casts, num_envs)
        self._view: Any = view(learners, venv.groups, num_envs)
        self.count: int = self._view.count
        self.observation_space: spaces.Space[Any] = self._view.observation_space
        self.action_space: spaces.Space[Any] = learners.group.action_space
        self.acting: NDArray[np.bool_] = self._view.acting
        self.masks: NDArray[np.int8] = self._view.masks
        self.acted = np.zeros(self.count, bool)
        self._lengths = np.zeros(self.count, np.int64)
        self._returns = np.zeros(self.count)
        self._seen: Any = None
        self._obs: Any = None
        self._infos: dict[str, Any] = {}

    def role_of(self, agent: Any) -> str:
        """The role of an agent, by the contract, else by its name."""
        return self._contract.role_of(agent) or role_in_name(str(agent))

    def reset(self, seed: int | None = None) -> Any:
        """Begins a run, without a seed the same one again: what each slot is given."""
        if seed is not None:
            self.seed = int(seed)
        self._obs, self._infos = self.venv.reset(seed=self.seed)
        self._lengths[...] = 0
        self._returns[...] = 0.0
        self.acted[...] = False
        self._begin_casts(range(self.venv.num_envs))
        self._seen = self._view.look(None, self._obs, self._infos, NOBODY)
        return self._seen

    def step(self, actions: Any) -> Step:
        """One step of every copy; actions of slots that don't act are passed over."""
        view, before = self._view, self._seen
        self.acted[...] = self.acting
        given = self._actions.joint(actions, self._obs, self._infos)
        obs, paid, *flags, infos = self.venv.step(given)
        self._obs, self._infos = obs, infos
        rewards, terminated, truncated = (view.by_slot(part) for part in (paid, *flags))
        over = infos["_final_obs"].nonzero()[0] if "_final_obs" in infos else NOBODY
        self._lengths += self.acted
        self._returns += rewards
        ended = terminated | truncated
        was_live = None if view.are_all_live else view.live.copy()
        self._begin_casts(over)
        self._seen = view.look(before, obs, infos, over)
        if len(over) or not view.are_all_live:
            terminated |= self._left(was_live, ended, over)
            ended = terminated | truncated
        if not ended.any():
            return Step(self._seen, rewards, terminated, truncated, {}, {}, {})
        slots = ended.nonzero()[0].tolist()
        final = {slot: view.final(slot, before, obs, infos) for slot in slots}
        lengths = dict(zip(slots, self._lengths[slots].tolist(), strict=True))
        returns = dict(zip(slots, self._returns[slots].tolist(), strict=True))
        self._begin_counts(slots, over)
        return Step(self._seen, rewards, terminated, truncated, final, lengths, returns)

    def close(self) -> None:
        """Closes every copy."""
        self.venv.close()

    def _left(self, was_live: Any, ended: Any, over: Any) -> Any:
        """Who is gone without an ending: not live any more, or its copy is over."""
        gone = ~ended if was_live is None else was_live & ~ended  # None: all of them were
        stays = self._view.live.reshape(self.venv.num_envs, -1).copy()
        stays[over] = False
        return gone & ~stays.reshape(-1)

    def _begin_counts(self, slots: Any, over: Any) -> None:
        for counts in (self._lengths, self._returns):
            counts[slots] = 0
            if len(over):
                counts.reshape(self.venv.num_envs, -1)[over] = 0

    def _begin_casts(self, copies: Any) -> None:
        for copy in copies if self._casts else ():
            self._casts[copy].begin(self.seed, int(self._infos["episode"][copy]))
