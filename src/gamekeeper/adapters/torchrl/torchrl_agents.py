"""Groups of agents in a TensorDict, and their columns in a vector environment.

Agents that act in turn keep their last observation while they wait or have ended. Agents that don't
learn act inside the environment, by their policies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.requirements import learners_of, policies_of_others, role_of
from gamekeeper.adapters.slot_views import OtherAgents
from gamekeeper.adapters.torchrl.torchrl_copies import Bools, Copies
from gamekeeper.adapters.torchrl.torchrl_specs import SpecPart, parts_of
from gamekeeper.errors import SpecError
from gamekeeper.interface.joint_policy import Choices
from gamekeeper.vector.vector_form import MASK


class Waiting:
    """Last observations of the agents of an AEC environment, and the agents that act next.

    Args:
        copies: of the environment.
        learning: groups of the agents that learn.
    """

    def __init__(self, copies: Copies, learning: list[TorchRLAgents]) -> None:
        self._copies, self._learning = copies, learning
        self._last = {
            each.name: [self._blank(each, part) for part in each.seen] for each in learning
        }
        self._was_shown: Bools = np.zeros((copies.num_envs, len(copies.agents)), bool)

    def _blank(self, each: TorchRLAgents, part: Any) -> NDArray[Any]:
        g, _ = each.runs[0]
        one = self._copies.arrays[f"obs.{g}.{part.place}"]
        return np.zeros((len(one), each.size, *one.shape[1:]), one.dtype)

    def clear(self, which: Bools) -> None:
        """Forgets what was shown in these copies."""
        self._was_shown[which] = False
        for arrays in self._last.values():
            for array in arrays:
                array[which] = 0

    def look(self, ended: Bools) -> None:
        """Keeps the observations of agents that act next or have ended in the last step.

        Args:
            ended: [copy, column].
        """
        arrays, copies = self._copies.arrays, np.flatnonzero(~self._copies.over)
        self._was_shown |= ended
        for each in self._learning if ended.any() else ():
            mine = ended[:, each.columns]
            for part, last in zip(each.seen, self._last[each.name], strict=True):
                last[mine] = each.stacked(arrays, "final", part.place)[mine]
        self._was_shown[copies, arrays["turn"][copies]] = True
        for each in self._learning:
            for rows, slots, g in self._turns(each):
                for part, last in zip(each.seen, self._last[each.name], strict=True):
                    last[rows, slots] = arrays[f"obs.{g}.{part.place}"][rows]

    def _turns(self, each: TorchRLAgents) -> Any:
        """Yields copies in which an agent of the group acts, its places, and the group there."""
        turn = self._copies.arrays["turn"]
        slots = np.where(self._copies.over, -1, each.slot_of[turn])
        for g, _ in each.runs:
            columns = self._copies.groups[g].columns
            rows = np.flatnonzero((slots >= 0) & (columns.start <= turn) & (turn < columns.stop))
            yield rows, slots[rows], g

    def in_turn(self) -> Bools:
        """[copy, column], agents that act next."""
        found = np.zeros_like(self._was_shown)
        copies = np.flatnonzero(~self._copies.over)
        found[copies, self._copies.arrays["turn"][copies]] = True
        return found

    def shown(self, each: TorchRLAgents) -> tuple[list[NDArray[Any]], Bools]:
        """Returns the group's last observations, and which of all agents had any."""
        return [array.copy() for array in self._last[each.name]], self._was_shown

    def masks(self, each: TorchRLAgents) -> Bools:
        """[copy, place, action], actions that the agents in turn may take."""
        legal = np.zeros((self._copies.num_envs, each.size, each.flags), bool)
        for rows, slots, g in self._turns(each):
            legal[rows, slots] = self._copies.arrays[f"mask.{g}"][rows].astype(bool)
        return legal

    def put(
        self,
        actions: dict[tuple[int, int], NDArray[Any]],
        each: TorchRLAgents,
        place: int,
        given: Any,
    ) -> None:
        """Puts the actions of agents in turn into the arrays of their groups."""
        for rows, slots, g in self._turns(each):
            actions[g, place][rows] = given[rows, slots]


def others_of(
    copies: Copies, learning: list[TorchRLAgents], others: Choices, spec: object, env_kwargs: Any
) -> OtherAgents:
    """Agents that act by given policies in each copy.

    Raises:
        SpecError: an agent has no policy, or all agents learn and there are policies.
    """
    learners = {column for each in learning for column in each.columns.tolist()}
    rest = [
        (group, place, agent)
        for group in copies.groups
        for place, agent in enumerate(group.agents)
        if group.first + place not in learners
    ]
    names, contract = [agent for *_, agent in rest], copies.contract
    policies = policies_of_others(spec, env_kwargs, names, others, contract, copies.num_envs)
    return OtherAgents(policies, copies.groups, rest, is_aec=copies.api == "aec")


@dataclass(frozen=True, slots=True)
class TorchRLAgents:
    """Agents whose tensors are stacked: one group of the TensorDict.

    Attributes:
        name: of the group.
        agents: in the order of their places.
        columns: [place], their columns in arrays by copy and agent.
        runs: numbers of the vector environment's groups that they are in, and their places there.
        slot_of: [column], the place of each agent; -1 if it isn't in the group.
        seen: the tensors of an observation.
        done: those of an action.
        choices: number of actions, part by part; empty where they have no mask.
        is_masked: the environment has masks.
    """

    name: str
    agents: tuple[Any, ...]
    columns: NDArray[np.intp]
    runs: tuple[tuple[int, NDArray[np.intp]], ...]
    slot_of: NDArray[np.intp]
    seen: list[SpecPart]
    done: list[SpecPart]
    choices: tuple[int, ...]
    is_masked: bool

    @property
    def size(self) -> int:
        """Number of agents."""
        return len(self.agents)

    @property
    def flags(self) -> int:
        """Length of a mask."""
        return sum(self.choices)

    def stacked(self, arrays: Mapping[str, NDArray[Any]], kind: str, place: int) -> NDArray[Any]:
        """Returns a copy of the group's part of an array by agents, [copy, place, ...].

        Args:
            arrays: of the vector environment.
            kind: `obs`, `final` or `mask`.
            place: the number of the leaf; -1: the array has none.
        """
        leaf = "" if place < 0 else f".{place}"
        found = [arrays[f"{kind}.{g}{leaf}"][:, places] for g, places in self.runs]
        return found[0] if len(found) == 1 else np.concatenate(found, axis=1)


def groups_of(copies: Copies, group_map: Any, role: str | None) -> list[TorchRLAgents]:
    """Returns the groups: as the user has them, else by role, and by spaces within.

    Args:
        copies: of the environment.
        group_map: names of agents by group, TorchRL's MarlGroupMapType, or None.
        role: only its agents, or the agent of that name; None: all agents.
    Raises:
        SpecError: a group's agents differ in their spaces; an agent is in two groups, or unknown.
    """
    mine = learners_of(copies.agents, role, copies.contract)
    if group_map is None:
        named = _by_role(copies, mine)
    else:
        if not isinstance(group_map, Mapping):
            group_map = group_map.get_group_map([str(agent) for agent in mine])
        named = _as_asked(group_map, mine)
    return [_group(copies, name, agents) for name, agents in named.items()]


def _by_role(copies: Copies, agents: Sequence[Any]) -> dict[str, list[Any]]:
    kinds = _kinds(copies)
    found: dict[str, list[Any]] = {}
    for agent in agents:
        name = role_of(copies.contract, agent)
        while name in found and kinds[found[name][0]] != kinds[agent]:
            name = str(agent)
        found.setdefault(name, []).append(agent)
    return found


def _as_asked(asked: Mapping[str, Sequence[Any]], agents: Sequence[Any]) -> dict[str, list[Any]]:
    by_name = {str(agent): agent for agent in agents}
    named = [str(agent) for members in asked.values() for agent in members]
    if sorted(named) != sorted(by_name):
        raise SpecError(
            "the groups don't hold every agent once",
            where="group_map",
            expected=", ".join(sorted(by_name)),
            actual=", ".join(sorted(named)),
            fix="leave group_map out: agents are grouped by role then",
        )
    return {str(name): [by_name[str(a)] for a in members] for name, members in asked.items()}


def _kinds(copies: Copies) -> dict[Any, tuple[Any, Any]]:
    return {a: (g.observation_space, g.action_space) for g in copies.groups for a in g.agents}


def _group(copies: Copies, name: str, agents: list[Any]) -> TorchRLAgents:
    kinds = _kinds(copies)
    if any(kinds[agent] != kinds[agents[0]] for agent in agents):
        raise SpecError(
            "agents of one group differ in their spaces, so no tensor can hold them",
            where=f"group_map[{name!r}]",
            expected="agents with one observation space and one action space",
            actual=", ".join(map(str, agents)),
            fix="leave group_map out: agents are grouped by role and spaces then",
        )
    observation_space, action_space = kinds[agents[0]]
    columns = np.array([copies.agents.index(agent) for agent in agents])
    slot_of = np.full(len(copies.agents), -1)
    slot_of[columns] = np.arange(len(agents))
    where = [
        (g, place)
        for column in columns.tolist()
        for g, group in enumerate(copies.groups)
        if 0 <= (place := column - group.first) < len(group.agents)
    ]
    runs = tuple(
        (g, np.array([place for _, place in members]))
        for g, members in groupby(where, key=lambda pair: pair[0])
    )
    return TorchRLAgents(
        name,
        tuple(agents),
        columns,
        runs,
        slot_of,
        parts_of(observation_space, without=MASK),
        parts_of(action_space),
        _choices(action_space),
        all(copies.groups[g].flags > 0 for g, _ in runs),
    )


def _choices(space: Any) -> tuple[int, ...]:
    if isinstance(space, spaces.Discrete):
        return (int(space.n),)
    if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1:
        return tuple(int(n) for n in space.nvec)
    return ()
