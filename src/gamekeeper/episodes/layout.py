"""Columns of a run: a place for each agent, a column for each leaf of its spaces."""

import json
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.canonical.json_text import clean
from gamekeeper.episodes.spaces import Codec, Leaf, space_to_json
from gamekeeper.errors import EvidenceError

AgentId = Hashable
LARGE_BYTES: Final = 8192  # an observation of this size stands in its row by its blake3


@dataclass(frozen=True, slots=True)
class Column:
    """One leaf of a space as a column: its name in the file, its tag in the row's digest.

    The tag carries no group, so that a fingerprint doesn't depend on other agents in the run.
    """

    name: str
    tag: str
    leaf: Leaf


@dataclass(frozen=True, slots=True)
class SpaceColumns:
    """One space of one agent (observations or actions): codec and columns, leaf by leaf."""

    codec: Codec
    columns: tuple[Column, ...]


@dataclass(slots=True)
class AgentColumns:
    """One agent's place in the columns; `observation` or `action` is None without a known space.

    `acts_as` is the type of its first whole-number action in the episode in progress, `action_type`
    the last such type that there was.
    """

    index: int
    agent: AgentId
    name: str
    observation: SpaceColumns | None
    action: SpaceColumns | None
    action_type: type | None = None
    acts_as: type | None = None


Group = tuple[tuple[Column, ...], NDArray[np.bool_]]


@dataclass(slots=True)
class Layout:
    """Agents and columns of a run; both only grow, when an agent comes that wasn't announced."""

    terms: tuple[str, ...] = ()
    state: SpaceColumns | None = None
    agents: dict[AgentId, AgentColumns] = field(default_factory=dict)
    order: list[AgentColumns] = field(default_factory=list)
    _names: set[str] = field(default_factory=set)
    _columns: dict[str, dict[str, Column]] = field(default_factory=dict)
    _shared: dict[tuple[Column, ...], tuple[Column, ...]] = field(default_factory=dict)
    _names_now: tuple[str, ...] = ()
    _groups_now: dict[str, tuple[int, list[Group]]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the agents in their order; the same object until another agent comes."""
        if len(self._names_now) != len(self.order):
            self._names_now = tuple(each.name for each in self.order)
        return self._names_now

    def groups(self, kind: str) -> list[Group]:
        """Distinct columns of `kind` ("obs" or "action"), and [agents] which agents have them."""
        count, groups = self._groups_now.get(kind, (0, []))
        order = list(self.order)  # it may grow meanwhile, in another thread
        if count != len(order):
            sides = [each.observation if kind == "obs" else each.action for each in order]
            # equal columns are handed out as one tuple, so identity tells groups apart
            distinct = {id(side.columns): side.columns for side in sides if side is not None}
            groups = [
                (columns, np.array([s is not None and s.columns is columns for s in sides], bool))
                for columns in distinct.values()
            ]
            self._groups_now[kind] = len(order), groups
        return groups

    def add(self, agent: AgentId, observation: Codec | None, action: Codec | None) -> AgentColumns:
        """Gives an agent its place, with new columns where its spaces are new."""
        name = agent_name(agent)
        while name in self._names:  # the agents 0 and "0" have one name
            name += "'"
        place = AgentColumns(
            len(self.order),
            agent,
            name,
            None if observation is None else self._side("obs", name, observation),
            None if action is None else self._side("action", name, action),
        )
        self.agents[agent] = place
        self.order.append(place)
        self._names.add(name)
        return place

    def announce(
        self,
        agents: Sequence[AgentId],
        codecs: Callable[[AgentId], tuple[Codec | None, Codec | None]],
    ) -> None:
        """Gives all `agents` their places at once: columns are named after groups that differ."""
        pairs = [(agent, *codecs(agent)) for agent in agents if agent not in self.agents]
        for kind, place in (("obs", 1), ("action", 2)):
            spaces = [(clean(_text(p[0])), p[place]) for p in pairs if p[place] is not None]
            groups = group_names(spaces)
            for codec, group in groups.items():
                for leaf in codec.leaves:
                    rivals = {
                        other for each in groups for other in each.leaves if other.path == leaf.path
                    }
                    self._add(kind, leaf, f"@{group}" if len(rivals) > 1 else "")
        for agent, observation, action in pairs:
            self.add(agent, observation, action)

    def take_state(self, codec: Codec | None) -> None:
        """Gives the environment's `state()` its columns, once its space is known."""
        self.state = None if codec is None else self._side("state", "", codec)

    def columns(self, kind: str) -> tuple[Column, ...]:
        """All columns of `kind` ("obs" or "action"), in the order in which they came."""
        return tuple(self._columns.get(kind, {}).values())

    def _side(self, kind: str, agent: str, codec: Codec) -> SpaceColumns:
        columns = tuple(self._column(kind, leaf, agent) for leaf in codec.leaves)
        return SpaceColumns(codec, self._shared.setdefault(columns, columns))

    def _column(self, kind: str, leaf: Leaf, agent: str) -> Column:
        known = self._columns.get(kind, {})
        for column in known.values():
            if column.leaf == leaf:
                return column
        taken = any(column.leaf.path == leaf.path for column in known.values())
        return self._add(kind, leaf, f"@{agent}" if taken else "")

    def _add(self, kind: str, leaf: Leaf, suffix: str) -> Column:
        tag = f"{kind}.{leaf.path}" if leaf.path else kind
        known = self._columns.setdefault(kind, {})
        column = Column(tag + suffix, tag, leaf)
        while known.get(column.name, column) != column:  # an agent that is called like a group
            column = Column(column.name + "'", tag, leaf)
        return known.setdefault(column.name, column)


def _text(agent: AgentId) -> str:
    """The text of an agent; of a subclass of `str`, whose methods are foreign, the bare one."""
    return str.__str__(agent) if isinstance(agent, str) else str(agent)


def agent_name(agent: AgentId) -> str:
    """An agent's name in columns: itself if it isn't empty and UTF-8 carries it, else its JSON."""
    if isinstance(agent, str):
        name = _text(agent)
        return name if name and clean(name) == name else to_json(name)
    return to_json(agent)


def group_names(spaces: Sequence[tuple[str, Any]]) -> dict[Codec, str]:
    """A name for each distinct layout: the prefix its agents alone share, or the first name."""
    groups: dict[str, tuple[Codec, list[str]]] = {}
    for name, codec in spaces:
        groups.setdefault(codec.signature, (codec, []))[1].append(name)
    prefixes = {key: {role(name) for name in names} for key, (_, names) in groups.items()}
    result = {}
    for key, (codec, names) in groups.items():
        others = set().union(*(found for other, found in prefixes.items() if other != key))
        is_theirs = len(prefixes[key]) == 1 and not prefixes[key] & others
        result[codec] = min(prefixes[key]) if is_theirs else names[0]
    return result


def role(agent: str) -> str:
    """The name of an agent without its number: `picker_0` is a `picker`."""
    head, _, tail = agent.rpartition("_")
    return head if head and tail.isdigit() else agent


def spaces_json(layout: Layout) -> dict[str, Mapping[str, object] | None]:
    """The spaces of every agent as plain JSON: `{"observation": ..., "action": ...}` by name.

    Agents that share their spaces share the objects too.
    """
    known: dict[tuple[Codec | None, ...], Mapping[str, object]] = {}
    spaces: dict[str, Mapping[str, object] | None] = {}
    for each in layout.order:
        sides = each.observation, each.action
        codecs = tuple(None if side is None else side.codec for side in sides)
        if codecs not in known:
            known[codecs] = {"observation": _json_of(sides[0]), "action": _json_of(sides[1])}
        spaces[each.name] = known[codecs]
    return spaces


def _json_of(columns: SpaceColumns | None) -> Mapping[str, object] | None:
    return None if columns is None else space_to_json(columns.codec.space)


_KINDS: Final = ("list", "bytes", "int", "text", "json")
_MOST: Final = 2**31
"""Elements of a value; more than memory holds, and still far from what overflows."""


def value_columns(schema: pa.Schema, kind: str) -> list[Column]:
    """The columns of `schema` that hold leaves of `kind` ("obs" or "action").

    Raises:
        EvidenceError: what a column says of itself can't be, or doesn't fit its type.
    """
    prefix = f"{kind}."
    return [each for each in leaf_columns(schema) if f"{each.tag}.".startswith(prefix)]


def leaf_columns(schema: pa.Schema) -> list[Column]:
    """The columns of `schema` that hold leaves of any space.

    Raises:
        EvidenceError: what a column says of itself can't be, or doesn't fit its type.
    """
    return [_column(field) for field in schema if field.metadata and b"leaf" in field.metadata]


def length_of(leaf: Leaf) -> int:
    """Number of elements of a value of this leaf."""
    return prod(leaf.shape)


def _column(field: pa.Field) -> Column:
    try:
        described = json.loads(field.metadata[b"leaf"])
        shape = tuple(described["shape"])
        leaf = Leaf(described["path"], described["kind"], described["dtype"], shape)
        column = Column(field.name, field.metadata[b"tag"].decode(), leaf)
        fits = _fits(leaf, field.type)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise _damaged(field, f"{type(error).__name__}: {error}") from None
    if not fits:
        raise _damaged(field, f"{field.type}, and {field.metadata[b'leaf']!r}")
    return column


def is_leaf(leaf: Leaf) -> bool:
    """True if a leaf that a file describes is one that a space can have."""
    if not isinstance(leaf.path, str) or leaf.kind not in _KINDS:
        return False
    if leaf.kind in ("text", "json", "int"):
        return True
    if any(type(length) is not int or length < 0 for length in leaf.shape):
        return False
    return not np.dtype(leaf.dtype).hasobject and length_of(leaf) <= _MOST


def _fits(leaf: Leaf, kind: pa.DataType) -> bool:
    """True if a column of this type can hold such a leaf."""
    if not is_leaf(leaf):
        return False
    if leaf.kind in ("text", "json"):
        return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))
    if leaf.kind == "int":
        return bool(pa.types.is_int64(kind))
    dtype: np.dtype[Any] = np.dtype(leaf.dtype)
    if leaf.kind == "bytes" or not length_of(leaf):
        return bool(pa.types.is_binary(kind) or pa.types.is_large_binary(kind))
    return bool(
        pa.types.is_fixed_size_list(kind)
        and kind.list_size == length_of(leaf)
        and kind.value_type.to_pandas_dtype() == dtype.type
    )


def _damaged(field: pa.Field, seen: str) -> EvidenceError:
    return EvidenceError(
        "the description of a column of values is damaged",
        where=field.name,
        expected="path, kind, dtype and shape of a leaf, as its type has them",
        actual=seen[:300],
        fix="restore the run from a copy, or record the run again",
    )
