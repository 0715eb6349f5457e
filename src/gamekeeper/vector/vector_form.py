"""Form of a vector environment's arrays: agents in columns, grouped where spaces differ."""

import mmap
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import role
from gamekeeper.errors import SpecError
from gamekeeper.interface.action_mask import Reader, reader
from gamekeeper.interface.capture import AgentId

Space: TypeAlias = spaces.Space[Any]
Path: TypeAlias = tuple[Any, ...]
"""Keys and indices from the root of a space to one of its leaves."""

ALL: Final = ""
"""The name of the only group, where all agents have the same spaces."""
MASK: Final = "action_mask"


@dataclass(frozen=True, slots=True)
class ArrayLeaf:
    """One array of a space: where it stands in a value, its dtype and shape."""

    path: Path
    dtype: str
    shape: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class VectorGroup:
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
    observed: tuple[ArrayLeaf, ...]
    acted: tuple[ArrayLeaf, ...]
    flags: int

    @property
    def columns(self) -> slice:
        """Its columns in arrays by env and agent."""
        return slice(self.first, self.first + len(self.agents))


@dataclass(frozen=True, slots=True)
class VectorForm:
    """The arrays of a vector environment, the same for every engine.

    Attributes:
        api: `aec` or `parallel`.
        groups: in the order of the columns.
        masks: finds each agent's action mask.
    """

    api: str
    groups: tuple[VectorGroup, ...]
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
            ("ended", (envs,), "|b1"),
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


def form_of(env: Any, api: str, contract: Contract | None, infos: Mapping[Any, Any]) -> VectorForm:
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
            actual=repr(getattr(env, "possible_agents", None)),
            fix="let it set possible_agents when it is made",
        )
    declared = contract or Contract()
    kinds = {agent: (env.observation_space(agent), env.action_space(agent)) for agent in agents}
    groups: list[VectorGroup] = []
    column = 0
    for name, members in _grouped(agents, kinds, declared).items():
        first = members[0]
        observed = tuple(leaves(kinds[first][0], f"observation_space({first!r})"))
        acted = tuple(leaves(kinds[first][1], f"action_space({first!r})"))
        flags = _flags(*kinds[first], declared.mask_of(first), _are_in_infos(members, infos))
        groups.append(
            VectorGroup(name, column, tuple(members), *kinds[first], observed, acted, flags)
        )
        column += len(members)
    masks = {agent: reader(declared.mask_of(agent)) for agent in agents}
    return VectorForm(api, tuple(groups), masks)


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


def leaves(space: Space, where: str, path: Path = ()) -> Iterator[ArrayLeaf]:
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
        yield ArrayLeaf(path, dtype.str, tuple(space.shape or ()))
    else:
        raise SpecError(
            "a space has no fixed shape, so no array can hold it",
            where=where,
            expected="Box, Discrete, MultiDiscrete, MultiBinary, and Dict or Tuple of them",
            actual=str(space)[:200],
            fix="flatten it in the environment, or step the copies one by one",
        )


def _are_in_infos(members: list[AgentId], infos: Mapping[Any, Any]) -> bool:
    """Tells whether infos hold masks: of one of these agents, or of any where none is there yet."""
    there = [agent for agent in members if agent in infos] or list(infos)
    return any(isinstance(infos[agent], Mapping) and MASK in infos[agent] for agent in there)


def _flags(observation: Space, action: Space, place: str | None, in_info: bool) -> int:
    """Length of an agent's masks; 0 where it has none."""
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


def changed(tree: Any, change: Callable[[Any], Any]) -> Any:
    """Returns the same tree with every array in it changed."""
    if isinstance(tree, dict):
        return {key: changed(part, change) for key, part in tree.items()}
    if isinstance(tree, tuple):
        return tuple(changed(part, change) for part in tree)
    return change(tree)


def clear(tree: Any, index: Any) -> None:
    """Writes zeros to an index of every array."""
    if isinstance(tree, dict | tuple):
        for part in tree.values() if isinstance(tree, dict) else tree:
            clear(part, index)
    else:
        tree[index] = 0


def getter(path: Path) -> Callable[[Any], Any]:
    """Function that follows a path into a value."""

    def get(value: Any) -> Any:
        for key in path:
            value = value[key]
        return value

    return get


Arrays: TypeAlias = Mapping[str, NDArray[Any]]
Plan: TypeAlias = Sequence[tuple[str, Sequence[int], str]]
"""Name, shape and dtype of every array."""

ALIGNMENT: Final = 64
"""Bytes; a line of the cache, so that no two arrays share one."""


def size_of(plan: Plan) -> int:
    """Bytes of all arrays of a plan."""
    return sum(_padded(shape, dtype) for _, shape, dtype in plan)


def arrays_in(memory: Any, plan: Plan) -> dict[str, NDArray[Any]]:
    """The arrays of a plan as views of `memory`."""
    found: dict[str, NDArray[Any]] = {}
    offset = 0
    for name, shape, dtype in plan:
        count = int(np.prod(shape, dtype=np.int64))
        view = np.frombuffer(memory, dtype, count, offset) if count else np.empty(0, dtype)
        found[name] = view.reshape(tuple(shape))
        offset += _padded(shape, dtype)
    return found


def own_memory(plan: Plan) -> bytearray:
    """Memory of this process alone, zeros."""
    return bytearray(max(size_of(plan), 1))


def _padded(shape: Sequence[int], dtype: str) -> int:
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    return -(-size // ALIGNMENT) * ALIGNMENT


class SharedMemory:
    """Memory without a name: it goes with the last process that holds it, however that ends.

    A child gets it by inheriting the descriptor. On Linux it is a memfd, elsewhere a file that is
    deleted as soon as it is open.
    """

    __slots__ = ("fd", "memory", "size")

    def __init__(self, size: int) -> None:
        self.size = max(size, 1)
        if hasattr(os, "memfd_create"):
            self.fd = os.memfd_create("gamekeeper-vector")
        else:
            with tempfile.TemporaryFile() as file:
                self.fd = os.dup(file.fileno())
        os.ftruncate(self.fd, self.size)
        self.memory = mmap.mmap(self.fd, self.size)

    def close(self) -> None:
        """Lets go of the descriptor; the memory goes once no array looks at it any more."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1


def attached(fd: int, size: int) -> mmap.mmap:
    """The memory behind an inherited descriptor."""
    return mmap.mmap(fd, size)


def part(arrays: Arrays, envs: slice) -> dict[str, NDArray[Any]]:
    """The arrays of some of the copies."""
    return {name: array[envs] for name, array in arrays.items()}
