"""Views of a vector environment by slot, and the actions of all its agents out of those of slots.

A slot is one learning agent of one sub-environment. Views tell what each slot is shown, which slots
act next and what they may do; the other agents' policies act beside them. Values are arrays, or
dictionaries and tuples of arrays, changed and filled part by part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.requirements import learners_of
from gamekeeper.contract import Contract
from gamekeeper.errors import SpecError
from gamekeeper.interface.joint_policy import JointPolicy
from gamekeeper.vector.vector_form import (
    ALL,
    MASK,
    Space,
    VectorGroup,
    built,
    changed,
    clear,
    leaves,
)


def at(tree: Any, index: Any) -> Any:
    """Returns the elements at an index of every array, as copies."""

    def own(array: Any) -> Any:
        value = array[index]
        return value.copy() if isinstance(value, np.ndarray) else value

    return changed(tree, own)


def put(tree: Any, index: Any, value: Any) -> None:
    """Writes a value of the same form to an index of every array."""
    if isinstance(tree, dict):
        for key, part in tree.items():
            put(part, index, value[key])
    elif isinstance(tree, tuple):
        for part, own in zip(tree, value, strict=True):
            put(part, index, own)
    else:
        tree[index] = value


def zeros(space: Space, lead: tuple[int, ...]) -> Any:
    """Returns zeros in the form of a space, with these axes in front."""
    return built(
        space, (np.zeros((*lead, *leaf.shape), leaf.dtype) for leaf in leaves(space, "space"))
    )


class SlotView:
    """Output of a vector environment, slot by slot. Use `TickView` or `TurnView`.

    Attributes:
        observation_space: of a slot.
        acting: [slot], slots that act in the next step.
        live: [slot], slots whose agents are live.
        are_all_live: all slots' agents are live.
        are_all_acting: all slots act in the next step.
        masks: [slot, action], actions that each may take; ones where it doesn't act.
    """

    def __init__(self, learners: Learners, groups: Sequence[VectorGroup], num_envs: int) -> None:
        self._learners, self._num_envs = learners, num_envs
        self._name, self._places = learners.group.name, learners.places
        self._is_one = groups[0].name == ALL
        self._is_whole = self._is_one and learners.are_all
        self.are_all_live = self.are_all_acting = False
        self.count = num_envs * len(learners)
        self.observation_space, self._key = bare_space(learners.group.observation_space)
        self.acting = np.zeros(self.count, bool)
        self.live = np.zeros(self.count, bool)
        self.masks: NDArray[np.int8] = np.ones((self.count, learners.group.flags), np.int8)

    def by_slot(self, part: Any) -> Any:
        """Returns an array by sub-environment and agent as a new array by slot."""
        return self._rows(self._of_group(part))

    def _rows(self, part: Any) -> Any:
        own = part.copy() if self._is_whole else np.array(self._of_learners(part), order="C")
        return own.reshape(self.count, *own.shape[2:])

    def _of_learners(self, part: Any) -> Any:
        return part if self._is_whole else part[:, self._places]

    def note_live(self, infos: Any) -> bool:
        """Notes which slots are live; returns True if all of them were before."""
        were_all, live = self.are_all_live, self._of_learners(self._of_group(infos["live"]))
        self.are_all_live = np.count_nonzero(live) == self.count
        if not (were_all and self.are_all_live):
            self.live.reshape(live.shape)[...] = live
        return were_all

    def look(self, before: Any, obs: Any, infos: Any, over: Any, ended: Any) -> Any:
        """Notes which slots act next, and returns each slot's observation, in arrays of its own.

        Args:
            before: observations that the slots had before; None at a reset.
            obs, infos: as the vector environment returned them.
            over: sub-environments that were reset in the last step.
            ended: [slot], slots that ended in it.
        """
        raise NotImplementedError

    def finals(self, slots: NDArray[np.intp], infos: Any) -> dict[int, Any]:
        """Returns last observations of slots that ended, zeros if their agents left without."""
        envs, learners = np.divmod(slots, len(self._learners))
        rows = infos["final_obs"].rows[envs] if "final_obs" in infos else np.full(len(slots), -1)
        if rows.max(initial=-1) < 0:
            found = zeros(self.observation_space, (len(slots),))
        else:
            last = self._bare(self._of_group(infos["final_obs"].tree))
            places = np.arange(len(self._learners.group.agents))[self._places]
            found = at(last, (rows, places[learners]))
            clear(found, rows < 0)
        rows = range(len(slots))
        each = (
            found
            if isinstance(found, np.ndarray)
            else (changed(found, itemgetter(i)) for i in rows)
        )
        return dict(zip(slots.tolist(), each, strict=True))

    def _of_group(self, part: Any) -> Any:
        return part if self._is_one else part[self._name]

    def _bare(self, obs: Any) -> Any:
        if not isinstance(obs, dict):
            return obs
        if self._key is not None:
            return obs[self._key]
        return {key: part for key, part in obs.items() if key != MASK}


class TickView(SlotView):
    """View of Parallel sub-environments: every live agent acts."""

    def look(self, before: Any, obs: Any, infos: Any, over: Any, ended: Any) -> Any:
        """Looks as every view does; agents that aren't live are shown zeros."""
        were_all_live = self.note_live(infos)
        self.are_all_acting = self.are_all_live
        if not (were_all_live and self.are_all_live):
            self.acting[...] = self.live
        found = changed(self._bare(self._of_group(obs)), self._rows)
        if self.masks.size:
            masks = self._of_learners(self._of_group(infos[MASK]))
            self.masks.reshape(masks.shape)[...] = masks
        if not self.are_all_live:
            gone = ~self.live
            clear(found, gone & ended)  # earlier ends are zeros already
            self.masks[gone] = 1
        return found


class TurnView(SlotView):
    """View of AEC sub-environments: one agent acts, the others keep their last observation."""

    def look(self, before: Any, obs: Any, infos: Any, over: Any, ended: Any) -> Any:
        """Looks as every view does; an agent that ended or had no turn yet is shown zeros."""
        self.note_live(infos)
        if before is None:
            found = zeros(self.observation_space, (self.count,))
        else:
            found = changed(before, np.copy)
        if len(over) or not self.are_all_live:
            is_new = ~self.live
            is_new.reshape(self._num_envs, -1)[over] = True
            clear(found, is_new)
        envs, slots = self._learners.in_turn(infos["turn"])
        self.acting.fill(False)
        self.acting[slots] = True
        self.are_all_acting = len(slots) == self.count
        put(found, slots, changed(self._bare(self._of_group(obs)), lambda part: part[envs]))
        if self.masks.size:
            self.masks.fill(1)
            self.masks[slots] = self._of_group(infos[MASK])[envs]
        return found


def bare_space(space: spaces.Space[Any]) -> tuple[spaces.Space[Any], str | None]:
    """Returns an observation space without the mask in it, and the key of its only other part.

    A Dict with one part beside the mask becomes that part; otherwise the key is None.
    """
    if not isinstance(space, spaces.Dict) or MASK not in space.spaces:
        return space, None
    rest = {key: part for key, part in space.spaces.items() if key != MASK}
    if len(rest) == 1:
        (key,) = rest
        return rest[key], key
    return spaces.Dict(rest), None


@dataclass(frozen=True, slots=True)
class Learners:
    """Agents that learn, A of them, all with the same spaces.

    Attributes:
        group: group that they belong to.
        agents: their names.
        places: their places in the arrays of the group; a slice where they are neighbours.
        learner_of: [column], number of the learner that an agent is; -1 if it doesn't learn.
        rest: other agents: group, place in it, name.
    """

    group: VectorGroup
    agents: tuple[Any, ...]
    places: slice | NDArray[np.intp]
    learner_of: NDArray[np.intp]
    rest: tuple[tuple[VectorGroup, int, Any], ...]

    def __len__(self) -> int:
        return len(self.agents)

    def in_turn(self, turn: NDArray[np.integer[Any]]) -> tuple[Any, NDArray[np.intp]]:
        """Returns the sub-environments in which a learner acts, as an index, and its slot in each.

        Args:
            turn: [env], the column of the agent that acts.
        """
        learner = self.learner_of[turn]
        firsts = np.arange(len(turn)) * len(self)
        if self.are_all:
            return slice(None), firsts + learner
        envs = np.flatnonzero(learner >= 0)
        return envs, firsts[envs] + learner[envs]

    @property
    def are_all(self) -> bool:
        """True if every agent learns."""
        return not self.rest


def find_learners(
    groups: Sequence[VectorGroup], role: str | None, contract: Contract | None
) -> Learners:
    """Returns the agents of a role, or the one agent of that name; None: all agents.

    Raises:
        SpecError: there are none, or they differ in their spaces.
    """
    whole = [(g, place, agent) for g in groups for place, agent in enumerate(g.agents)]
    names = learners_of([agent for _, _, agent in whole], role, contract)
    chosen = [one for one in whole if one[2] in names]
    group = chosen[0][0]
    if any(other is not group for other, _, _ in chosen):
        raise SpecError(
            "one policy can't be shared by agents that differ in their spaces",
            where="role",
            expected="agents with one observation space and one action space",
            actual=", ".join(each.name for each in groups),
            fix="name the role that learns, and give the others policies",
        )
    places = np.array([place for _, place, _ in chosen])
    learner_of = np.full(len(whole), -1)
    learner_of[group.first + places] = np.arange(len(places))
    first, last = int(places[0]), int(places[-1])
    are_neighbours = last - first + 1 == len(places)
    return Learners(
        group,
        tuple(names),
        slice(first, last + 1) if are_neighbours else places,
        learner_of,
        tuple(one for one in whole if one[2] not in names),
    )


class OtherAgents:
    """Agents that don't learn: in each sub-environment their policies act.

    Args:
        policies: of each sub-environment; empty where every agent learns.
        groups: of the vector environment.
        rest: the agents: group, place in it, name.
        is_aec: one agent acts in a step.
    """

    def __init__(
        self,
        policies: Sequence[JointPolicy],
        groups: Sequence[VectorGroup],
        rest: Sequence[tuple[VectorGroup, int, Any]],
        *,
        is_aec: bool,
    ) -> None:
        self._policies, self._rest, self._is_aec = policies, rest, is_aec
        self._is_one = groups[0].name == ALL
        self._by_column = {group.first + place: [(group, place, a)] for group, place, a in rest}

    def begin(self, envs: Any, seed: int, infos: Any) -> None:
        """Begins new episodes in these sub-environments, of the run of this seed."""
        for env in envs if self._policies else ():
            self._policies[env].begin(seed, int(infos["episode"][env]))

    def act(self, joint: dict[str, Any], obs: Any, infos: Any) -> None:
        """Writes the actions of the other agents that act now.

        Args:
            joint: by group, actions [env, agent, ...]; of AEC environments [env, ...].
            obs, infos: as the vector environment returned them last.
        """
        for env, policies in enumerate(self._policies):
            for group, place, agent in self._acting(env, infos):
                index = env if self._is_aec else (env, place)
                seen = at(obs if self._is_one else obs[group.name], index)
                action = policies.act(agent, seen, infos["agents"][env].get(agent, {}))
                put(joint[group.name], index, action)

    def _acting(self, env: int, infos: Any) -> Sequence[tuple[VectorGroup, int, Any]]:
        if self._is_aec:
            return self._by_column.get(int(infos["turn"][env]), ())
        live = infos["live"]
        return [
            (group, place, agent)
            for group, place, agent in self._rest
            if (live if self._is_one else live[group.name])[env, place]
        ]


class SlotActions:
    """Actions of all agents, out of those of slots; arrays are used again at every step.

    Args:
        learners: agents of the slots.
        groups: of the vector environment.
        others: the other agents.
        num_envs: number of sub-environments.
        is_aec: one agent acts in a step.
    """

    def __init__(
        self,
        learners: Learners,
        groups: Sequence[VectorGroup],
        others: OtherAgents,
        num_envs: int,
        *,
        is_aec: bool,
    ) -> None:
        self._learners, self._others, self._num_envs = learners, others, num_envs
        self._is_aec = is_aec
        self._joint = {
            group.name: zeros(
                group.action_space, (num_envs,) if is_aec else (num_envs, len(group.agents))
            )
            for group in groups
        }

    def joint(self, actions: Any, obs: Any, infos: Any) -> Any:
        """Returns the actions of all agents, as the vector environment takes them.

        Args:
            actions: [slot, ...]; those of slots that don't act are ignored.
            obs, infos: as the vector environment returned them last.
        """
        if self._is_aec:
            index, slots = self._learners.in_turn(infos["turn"])
            own = changed(actions, lambda part: np.asarray(part)[slots])
        else:
            index = slice(None), self._learners.places
            own = changed(actions, self._by_env)
        if self._learners.are_all:
            return own
        put(self._joint[self._learners.group.name], index, own)
        self._others.act(self._joint, obs, infos)
        return self._joint.get(ALL, self._joint)

    def _by_env(self, part: Any) -> Any:
        array = np.asarray(part)
        return array.reshape(self._num_envs, len(self._learners), *array.shape[1:])
