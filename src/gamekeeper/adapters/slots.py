"""Slots: the learning agents of all sub-environments, one slot for each; others follow policies.

A slot is one agent's stream of decisions, whatever the API: in a Parallel environment it acts in
every step in which it is live, in an AEC environment when its turn comes. `acted` tells which slots
did; a reward of a slot that didn't act belongs to the last action that it took.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.requirements import closed_on_error, policies_of_others, role_of
from gamekeeper.adapters.slot_views import (
    OtherAgents,
    SlotActions,
    TickView,
    TurnView,
    find_learners,
)
from gamekeeper.interface.joint_policy import Choices
from gamekeeper.vector.vector_factory import make

NO_ENVS: Final = np.zeros(0, np.intp)


@dataclass(frozen=True, slots=True)
class Step:
    """Outcome of one step for each slot; arrays are [slot, ...].

    Attributes:
        obs: next observations; zeros where no agent is live, the last one of an agent that waits.
        rewards: of this step.
        terminated, truncated: slots that ended in it; one that left without an ending counts as
            terminated.
        ended: either.
        final: by slot that ended, its last observation; zeros where its agent left without one.
        lengths, returns: by slot that ended, its decisions in the episode, and its return.
    """

    obs: Any
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    ended: NDArray[np.bool_]
    final: Mapping[int, Any]
    lengths: Mapping[int, int]
    returns: Mapping[int, float]


class Slots:
    """Learning agents of many sub-environments, each in a slot.

    Slot e * A + a is learner a of sub-environment e.

    Args:
        spec, num_envs, seed: as for `gk.vector.make`.
        role: role, or name of the one agent, that learns; None: all agents learn.
        others: policies of the other agents, one for all or by agent or role. A policy object is
            shared by all sub-environments, a class or a name makes one for each.
        options: of `gk.vector.make`: engine, workers, threads, env_kwargs, contract, timeout_s.

    Attributes:
        venv: the vector environment; its arrays are overwritten by every step.
        group: group of the learners, which has their spaces.
        learners: names of the learning agents, A of them.
        count: number of slots.
        observation_space, action_space: of a slot.
        acted: [slot], slots that acted in the last step.
        have_all_acted: all of them did.
        acting: [slot], slots that act in the next one.
        masks: [slot, action], actions that each may take; ones where it doesn't matter.
        seed: of the run.
        runs: how many runs were begun.
        is_watched: a buffer leaves out steps in which slots don't act.
    Raises:
        SpecError: the learners differ in their spaces, or another agent has no policy.
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
        self.seed, self.runs, self.is_watched = seed, 0, False
        self._contract = venv.seen.contract
        with closed_on_error(venv):
            learners = find_learners(venv.groups, role, self._contract)
            names = [agent for _, _, agent in learners.rest]
            policies = policies_of_others(
                spec, options.get("env_kwargs"), names, others, self._contract, num_envs
            )
        self.group, self.learners = learners.group, list(learners.agents)
        is_aec = venv.api == "aec"
        self._others = OtherAgents(policies, venv.groups, learners.rest, is_aec=is_aec)
        self._actions = SlotActions(learners, venv.groups, self._others, num_envs, is_aec=is_aec)
        self._view = (TurnView if is_aec else TickView)(learners, venv.groups, num_envs)
        self.count = self._view.count
        self.observation_space = self._view.observation_space
        self.action_space: spaces.Space[Any] = learners.group.action_space
        # the view's own arrays: it overwrites them at every step
        self.acting, self.masks = self._view.acting, self._view.masks
        self.acted, self.have_all_acted = np.zeros(self.count, bool), False
        self._lengths = np.zeros(self.count, np.int64)
        self._returns = np.zeros(self.count)
        self._seen: Any = None
        self._obs: Any = None
        self._infos: dict[str, Any] = {}

    def role_of(self, agent: Any) -> str:
        """Role of an agent, by the contract, else by its name."""
        return role_of(self._contract, agent)

    def reset(self, seed: int | None = None) -> Any:
        """Begins a run (without a seed the same one again), and returns each slot's observation."""
        if seed is not None:
            self.seed = int(seed)
        self.runs += 1
        self._obs, self._infos = self.venv.reset(seed=self.seed)
        self._lengths[...] = 0
        self._returns[...] = 0.0
        self.acted[...] = self.have_all_acted = False
        self._others.begin(range(self.venv.num_envs), self.seed, self._infos)
        self._seen = self._view.look(None, self._obs, self._infos, NO_ENVS, self.acted)
        return self._seen

    def step(self, actions: Any) -> Step:
        """Steps every sub-environment; actions of slots that don't act are ignored."""
        view = self._view
        have_all_acted = self.have_all_acted = view.are_all_acting
        self.acted[...] = self.acting
        joint = self._actions.joint(actions, self._obs, self._infos)
        self._obs, paid, *flags, infos = self.venv.step(joint)
        self._infos = infos
        rewards, terminated, truncated = (view.by_slot(part) for part in (paid, *flags))
        over = infos["over"].nonzero()[0]
        self._lengths += 1 if have_all_acted else self.acted
        self._returns += rewards
        ended = terminated | truncated
        self._others.begin(over, self.seed, infos)
        self._seen = view.look(self._seen, self._obs, infos, over, ended)
        if not np.count_nonzero(ended):
            return Step(self._seen, rewards, terminated, truncated, ended, {}, {}, {})
        final = view.finals(ended.nonzero()[0], infos)
        slots = list(final)
        lengths = dict(zip(slots, self._lengths[slots].tolist(), strict=True))
        returns = dict(zip(slots, self._returns[slots].tolist(), strict=True))
        for counts in (self._lengths, self._returns):
            counts[slots] = 0
            counts.reshape(self.venv.num_envs, -1)[over] = 0
        return Step(self._seen, rewards, terminated, truncated, ended, final, lengths, returns)

    def close(self) -> None:
        """Closes every sub-environment."""
        self.venv.close()
