"""What goes in: actions of slots, and those of who doesn't learn, as the vector environment takes them.

The arrays are used again at every step; the vector environment copies what it takes.
"""  # noqa: E501  # a claim is one line

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gamekeeper.adapters.slots.learners import Learners
from gamekeeper.adapters.slots.trees import at, changed, put, zeros
from gamekeeper.game.casting.cast import Cast
from gamekeeper.vector.form import ALL, Group


class _Actions:
    """Arrays of actions by group, and the players of who doesn't learn."""

    def __init__(
        self, learners: Learners, groups: Sequence[Group], casts: Sequence[Cast], num_envs: int
    ) -> None:
        self._learners, self._casts, self._copies = learners, casts, num_envs
        self._is_one = groups[0].name == ALL
        self._given = {
            group.name: zeros(group.action_space, group.acted, self._lead(group))
            for group in groups
        }
        self._who = [(group, agent) for group in groups for agent in group.agents]

    def _lead(self, group: Group) -> tuple[int, ...]:
        raise NotImplementedError

    def _chosen(self, copy: int, group: Group, index: Any, agent: Any, obs: Any, infos: Any) -> Any:
        """What a policy does for an agent that it plays."""
        seen = at(obs if self._is_one else obs[group.name], index)
        return self._casts[copy].act(agent, seen, infos["agents"][copy].get(agent, {}))

    def _whole(self) -> Any:
        return self._given[ALL] if self._is_one else self._given


class TickActions(_Actions):
    """Of Parallel copies: everybody acts."""

    def _lead(self, group: Group) -> tuple[int, ...]:
        return self._copies, len(group.agents)

    def joint(self, actions: Any, obs: Any, infos: Any) -> Any:
        """The actions of all agents.

        Args:
            actions: [slot, ...].
            obs, infos: what the vector environment gave last; who isn't there isn't asked.
        """
        count = len(self._learners)

        def by_copy(part: Any) -> Any:
            array = np.asarray(part)
            return array.reshape(self._copies, count, *array.shape[1:])

        own = changed(actions, by_copy)
        if self._learners.are_all:
            return own
        put(self._given[self._learners.group.name], (slice(None), self._learners.places), own)
        live = infos["live"]
        for copy in range(self._copies):
            for group, place, agent in self._learners.rest:
                if (live if self._is_one else live[group.name])[copy, place]:
                    index = copy, place
                    action = self._chosen(copy, group, index, agent, obs, infos)
                    put(self._given[group.name], index, action)
        return self._whole()


class TurnActions(_Actions):
    """Of AEC copies: one agent acts in each."""

    def _lead(self, group: Group) -> tuple[int, ...]:
        return (self._copies,)

    def joint(self, actions: Any, obs: Any, infos: Any) -> Any:
        """The action of whoever's turn it is in each copy; arguments as of ticks."""
        turn = infos["turn"]
        copies, slots = self._learners.in_turn(turn)
        mine = changed(actions, lambda part: np.asarray(part)[slots])
        if self._learners.are_all:
            return mine
        put(self._given[self._learners.group.name], copies, mine)
        for copy in np.flatnonzero(self._learners.learner_of[turn] < 0).tolist():
            group, agent = self._who[turn[copy]]
            action = self._chosen(copy, group, copy, agent, obs, infos)
            put(self._given[group.name], copy, action)
        return self._whole()
