"""Agents that don't learn: their policies act inside the environment."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.adapters.others import require_policies
from gamekeeper.adapters.torchrl.copies import Copies
from gamekeeper.adapters.torchrl.seats import role_of
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Cast, Choices
from gamekeeper.game.open import open_env
from gamekeeper.record.recording import cast_of
from gamekeeper.vector.form import built


class Others:
    """Who acts by a given policy in each copy.

    Args:
        copies: of the environment.
        learners: columns of those who don't.
        others: policies of all the rest.
        spec, env_kwargs: what there are copies of.
    Raises:
        SpecError: somebody has no policy, or there is nobody to have one.
    """

    def __init__(
        self, copies: Copies, learners: set[int], others: Choices, spec: object, env_kwargs: Any
    ) -> None:
        self._copies = copies
        self._columns = [c for c in range(len(copies.agents)) if c not in learners]
        self._group_of = {
            group.first + place: (g, group, place)
            for g, group in enumerate(copies.groups)
            for place in range(len(group.agents))
        }
        self._casts: list[Cast] = []
        if not self._columns:
            if others:
                raise SpecError(
                    "there are policies for others, and everybody learns",
                    where="others", mend="name the role that learns",
                )  # fmt: skip
            return
        rest = [copies.agents[column] for column in self._columns]
        require_policies(rest, others, lambda agent: role_of(copies, agent))
        env = open_env(spec, **dict(env_kwargs or {})).env
        try:
            self._casts = [cast_of(others, env, copies.contract) for _ in range(copies.num_envs)]
        finally:
            env.close()

    def begin(self, which: NDArray[np.bool_]) -> None:
        """New episodes begin in these copies."""
        if self._casts:
            for copy in np.flatnonzero(which).tolist():
                episode = int(self._copies.arrays["episode"][copy])
                self._casts[copy].begin(self._copies.run_seed, episode)

    def act(self, actions: dict[tuple[int, int], NDArray[Any]]) -> None:
        """Puts their actions beside those of the learners; arrays are by group and leaf."""
        if not self._casts:
            return
        arrays, over = self._copies.arrays, self._copies.over
        if self._copies.api == "aec":
            turn = arrays["turn"]
            for copy in np.flatnonzero(np.isin(turn, self._columns) & ~over).tolist():
                self._put(actions, copy, int(turn[copy]), (copy,), (copy,))
            return
        for column in self._columns:
            _, _, place = self._group_of[column]
            for copy in np.flatnonzero(arrays["live"][:, column] & ~over).tolist():
                self._put(actions, copy, column, (copy, place), (copy, place))

    def _put(
        self,
        actions: Any,
        copy: int,
        column: int,
        seen_at: tuple[int, ...],
        put_at: tuple[int, ...],
    ) -> None:
        g, group, _ = self._group_of[column]
        agent, arrays = self._copies.agents[column], self._copies.arrays
        leaves = (np.copy(arrays[f"obs.{g}.{i}"][seen_at]) for i in range(len(group.observed)))
        observation = built(group.observation_space, leaves)
        told = self._copies.told.get(copy, {}).get(agent, {})
        action: Any = self._casts[copy].act(agent, observation, told)
        for i, leaf in enumerate(group.acted):
            value = action
            for key in leaf.path:
                value = value[key]
            actions[g, i][put_at] = value
