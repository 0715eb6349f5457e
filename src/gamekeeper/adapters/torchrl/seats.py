"""Who sits where: agents in groups of a TensorDict, and their columns in a vector environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.torchrl.copies import Copies
from gamekeeper.adapters.torchrl.specs import MASK, Part, parts_of
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.errors import SpecError


@dataclass(frozen=True, slots=True)
class Seats:
    """Agents whose tensors are stacked: one group of the TensorDict.

    Attributes:
        name: of the group.
        agents: in the order of their places.
        columns: [place], their columns in arrays by copy and agent.
        runs: numbers of the vector environment's groups that they are in, and their places there.
        slot_of: [column], the place of each agent of the game; -1 for who isn't in the group.
        seen: the tensors of an observation.
        done: those of an action.
        choices: how many actions there are, part by part; empty where a mask can't tell.
        is_masked: whether the environment says which are legal.
    """

    name: str
    agents: tuple[Any, ...]
    columns: NDArray[np.intp]
    runs: tuple[tuple[int, NDArray[np.intp]], ...]
    slot_of: NDArray[np.intp]
    seen: list[Part]
    done: list[Part]
    choices: tuple[int, ...]
    is_masked: bool

    @property
    def size(self) -> int:
        """How many agents."""
        return len(self.agents)

    @property
    def flags(self) -> int:
        """How long a mask is."""
        return sum(self.choices)

    def stacked(self, arrays: Mapping[str, NDArray[Any]], kind: str, place: int) -> NDArray[Any]:
        """A copy of the group's part of an array by agents, [copy, place, ...].

        Args:
            arrays: of the vector environment.
            kind: `obs`, `final` or `mask`.
            place: the number of the leaf; -1: the array has none.
        """
        leaf = "" if place < 0 else f".{place}"
        found = [arrays[f"{kind}.{g}{leaf}"][:, places] for g, places in self.runs]
        return found[0] if len(found) == 1 else np.concatenate(found, axis=1)


def seats_of(copies: Copies, group_map: Any, role: str | None) -> list[Seats]:
    """The groups: as the user has them, else by role, and by spaces within.

    Args:
        copies: whose agents.
        group_map: names of agents by group, TorchRL's MarlGroupMapType, or None.
        role: only its agents, or the agent of that name; None: all.
    Raises:
        SpecError: a group's agents differ in their spaces; somebody is in two groups or unknown.
    """
    mine = [a for a in copies.agents if role in (None, role_of(copies, a), str(a))]
    if not mine:
        known = sorted({role_of(copies, agent) for agent in copies.agents})
        raise SpecError(
            f"nobody has the role {role!r}",
            where="role",
            expected=", ".join(known),
            seen=repr(role),
        )
    if group_map is None:
        named = _by_role(copies, mine)
    else:
        if not isinstance(group_map, Mapping):
            group_map = group_map.get_group_map([str(agent) for agent in mine])
        named = _as_asked(group_map, mine)
    return [_seated(copies, name, agents) for name, agents in named.items()]


def role_of(copies: Copies, agent: Any) -> str:
    """The role of an agent, by the contract, else by its name."""
    return str(copies.contract.role_of(agent) or role_in_name(str(agent)))


def _by_role(copies: Copies, agents: Sequence[Any]) -> dict[str, list[Any]]:
    kinds = _kinds(copies)
    found: dict[str, list[Any]] = {}
    for agent in agents:
        name = role_of(copies, agent)
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
            seen=", ".join(sorted(named)),
            mend="leave group_map out: agents are grouped by role then",
        )
    return {str(name): [by_name[str(a)] for a in members] for name, members in asked.items()}


def _kinds(copies: Copies) -> dict[Any, tuple[Any, Any]]:
    return {a: (g.observation_space, g.action_space) for g in copies.groups for a in g.agents}


def _seated(copies: Copies, name: str, agents: list[Any]) -> Seats:
    kinds = _kinds(copies)
    if any(kinds[agent] != kinds[agents[0]] for agent in agents):
        raise SpecError(
            "agents of one group differ in their spaces, so no tensor can hold them",
            where=f"group_map[{name!r}]",
            expected="agents with one observation space and one action space",
            seen=", ".join(map(str, agents)),
            mend="leave group_map out: agents are grouped by role and spaces then",
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
    return Seats(
        name, tuple(agents), columns, runs, slot_of, parts_of(observation_space, without=MASK),
        parts_of(action_space), _choices(action_space),
        all(copies.groups[g].flags > 0 for g, _ in runs),
    )  # fmt: skip


def _choices(space: Any) -> tuple[int, ...]:
    if isinstance(space, spaces.Discrete):
        return (int(space.n),)
    if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1:
        return tuple(int(n) for n in space.nvec)
    return ()
