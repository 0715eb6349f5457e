"""Which arrays a vector environment has: agents in columns, grouped where their spaces differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium import spaces

from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import role
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.mask import Reader, reader
from gamekeeper.game.door import AgentId

Space: TypeAlias = spaces.Space[Any]
Path: TypeAlias = tuple[Any, ...]
"""Keys and indices from the root of a space to one of its leaves."""

ALL: Final = ""
"""The name of the only group, where all agents have the same spaces."""
MASK: Final = "action_mask"


@dataclass(frozen=True, slots=True)
class Leaf:
    """One array of a space: where it stands in a value, its dtype and shape."""

    path: Path
    dtype: str
    shape: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Group:
    """Agents that share their spaces.

    Attributes:
        name: their role; empty where all agents are one group.
        first: the column of its first agent.
        agents: their names, in the order of the columns.
        observation_space: of each of them.
        action_space: of each of them.
        observed: the leaves of an observation.
        acted: the leaves of an action.
        flags: how long an action mask is; 0 where there is none.
    """

    name: str
    first: int
    agents: tuple[AgentId, ...]
    observation_space: Space
    action_space: Space
    observed: tuple[Leaf, ...]
    acted: tuple[Leaf, ...]
    flags: int

    @property
    def columns(self) -> slice:
        """Its columns in arrays by env and agent."""
        return slice(self.first, self.first + len(self.agents))


@dataclass(frozen=True, slots=True)
class Form:
    """The arrays of a vector environment, the same for every engine.

    Attributes:
        api: `aec` or `parallel`.
        groups: in the order of the columns.
        masks: finds each agent's action mask.
    """

    api: str
    groups: tuple[Group, ...]
    masks: Mapping[AgentId, Reader]

    @property
    def agents(self) -> tuple[AgentId, ...]:
        """All agents, in the order of the columns."""
        return tuple(agent for group in self.groups for agent in group.agents)

    def plan(self, envs: int) -> list[tuple[str, tuple[int, ...], str]]:
        """Name, shape and dtype of every array for so many copies."""
        agents = len(self.agents)
        by_agent: tuple[int, ...] = (envs, agents)
        found: list[tuple[str, tuple[int, ...], str]] = [
            ("rewards", by_agent, "<f8"),
            ("terminated", by_agent, "|b1"),
            ("truncated", by_agent, "|b1"),
            ("live", by_agent, "|b1"),
            ("over", (envs,), "|b1"),
            ("turn", (envs,), "<i4"),
            ("episode", (envs,), "<i8"),
            ("cursor", (envs,), "<i4"),
        ]
        for g, group in enumerate(self.groups):
            own = (envs, len(group.agents))
            given = (envs,) if self.api == "aec" else own
            for i, leaf in enumerate(group.observed):
                found.append((f"obs.{g}.{i}", (*given, *leaf.shape), leaf.dtype))
                found.append((f"final.{g}.{i}", (*own, *leaf.shape), leaf.dtype))
            for i, leaf in enumerate(group.acted):
                found.append((f"action.{g}.{i}", (*given, *leaf.shape), leaf.dtype))
            if group.flags:
                found.append((f"mask.{g}", (*given, group.flags), "|i1"))
        return found


def form_of(env: Any, api: str, contract: Contract | None, infos: Mapping[Any, Any]) -> Form:
    """The form of `env`.

    Args:
        env: was reset, so that it is known where masks stand.
        infos: what the reset gave, by agent.
    Raises:
        SpecError: it doesn't name its agents before it runs, or a space has no fixed shape.
    """
    agents = list(getattr(env, "possible_agents", None) or ())
    if not agents:
        raise SpecError(
            "the environment doesn't name its agents before it runs",
            where="possible_agents",
            expected="a list of all agents that may appear",
            seen=repr(getattr(env, "possible_agents", None)),
            mend="let it set possible_agents when it is made",
        )
    declared = contract or Contract()
    kinds = {agent: (env.observation_space(agent), env.action_space(agent)) for agent in agents}
    groups: list[Group] = []
    column = 0
    for name, members in _grouped(agents, kinds, declared).items():
        first = members[0]
        observed = tuple(leaves(kinds[first][0], f"observation_space({first!r})"))
        acted = tuple(leaves(kinds[first][1], f"action_space({first!r})"))
        flags = _flags(*kinds[first], declared.mask_of(first), _is_told(members, infos))
        groups.append(Group(name, column, tuple(members), *kinds[first], observed, acted, flags))
        column += len(members)
    masks = {agent: reader(declared.mask_of(agent)) for agent in agents}
    return Form(api, tuple(groups), masks)


def _grouped(
    agents: list[AgentId], kinds: Mapping[AgentId, tuple[Space, Space]], contract: Contract
) -> dict[str, list[AgentId]]:
    """Agents by group: one where all have the same spaces, else by role, and by spaces within."""
    if all(kinds[agent] == kinds[agents[0]] for agent in agents):
        return {ALL: agents}
    groups: dict[str, list[AgentId]] = {}
    for agent in agents:
        name = contract.role_of(agent) or role(str(agent))
        while name in groups and kinds[groups[name][0]] != kinds[agent]:
            name = str(agent)
        groups.setdefault(name, []).append(agent)
    return groups


def leaves(space: Space, where: str, path: Path = ()) -> Iterator[Leaf]:
    """The leaves of a space, depth first.

    Raises:
        SpecError: a part of it has no fixed shape.
    """
    if isinstance(space, spaces.Dict):
        for key, part in space.spaces.items():
            yield from leaves(part, where, (*path, key))
    elif isinstance(space, spaces.Tuple):
        for place, part in enumerate(space.spaces):
            yield from leaves(part, where, (*path, place))
    elif isinstance(
        space, spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary
    ):
        dtype = np.dtype(space.dtype).newbyteorder("<")
        yield Leaf(path, dtype.str, tuple(space.shape or ()))
    else:
        raise SpecError(
            "a space has no fixed shape, so no array can hold it",
            where=where,
            expected="Box, Discrete, MultiDiscrete, MultiBinary, and Dict or Tuple of them",
            seen=str(space)[:200],
            mend="flatten it in the environment, or step the copies one by one",
        )


def _is_told(members: list[AgentId], infos: Mapping[Any, Any]) -> bool:
    """Whether infos hold masks: of one of these agents, or, where none is there yet, of anybody."""
    there = [agent for agent in members if agent in infos] or list(infos)
    return any(isinstance(infos[agent], Mapping) and MASK in infos[agent] for agent in there)


def _flags(observation: Space, action: Space, place: str | None, in_info: bool) -> int:
    """How long the masks of an agent are; 0 where it has none."""
    in_space = isinstance(observation, spaces.Dict) and MASK in observation.spaces
    if place is None and not in_space and not in_info:
        return 0
    if isinstance(action, spaces.Discrete):
        return int(action.n)
    if isinstance(action, spaces.MultiDiscrete):
        return int(action.nvec.sum())
    return 0


def built(space: Space, arrays: Iterator[Any]) -> Any:
    """The arrays of a space's leaves put together as its values are: dictionaries and tuples."""
    if isinstance(space, spaces.Dict):
        return {key: built(part, arrays) for key, part in space.spaces.items()}
    if isinstance(space, spaces.Tuple):
        return tuple(built(part, arrays) for part in space.spaces)
    return next(arrays)


def getter(path: Path) -> Callable[[Any], Any]:
    """What follows a path into a value."""

    def get(value: Any) -> Any:
        for key in path:
            value = value[key]
        return value

    return get
