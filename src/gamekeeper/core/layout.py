"""Which columns a run has: a seat for each agent, a column for each leaf of its spaces."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from gamekeeper.core.canon import to_json
from gamekeeper.core.canon.text import clean
from gamekeeper.core.space import Codec, Leaf, space_to_json

AgentId = Hashable
LARGE_BYTES: Final = 8192  # an observation of this size stands in its row by its blake3


@dataclass(frozen=True, slots=True)
class Column:
    """One leaf of a space as a column: its name in the file, its tag in the row's digest.

    The tag carries no group, so that a fingerprint doesn't depend on who else is in the run.
    """

    name: str
    tag: str
    leaf: Leaf


@dataclass(frozen=True, slots=True)
class Side:
    """One space of one seat (what it observes, or how it acts): codec and columns, leaf by leaf."""

    codec: Codec
    columns: tuple[Column, ...]


@dataclass(slots=True)
class Seat:
    """One agent's place in the columns; `observation` or `action` is None without a known space.

    `acts_as` is the type of its first whole-number action in the episode in progress, `action_type`
    the last such type that there was.
    """

    index: int
    agent: AgentId
    name: str
    observation: Side | None
    action: Side | None
    action_type: type | None = None
    acts_as: type | None = None


@dataclass(slots=True)
class Layout:
    """Seats and columns of a run; both only grow, when agents come that nobody announced."""

    terms: tuple[str, ...] = ()
    state: Side | None = None
    seats: dict[AgentId, Seat] = field(default_factory=dict)
    order: list[Seat] = field(default_factory=list)
    _names: set[str] = field(default_factory=set)
    _columns: dict[str, dict[str, Column]] = field(default_factory=dict)
    _shared: dict[tuple[Column, ...], tuple[Column, ...]] = field(default_factory=dict)

    def seat(self, agent: AgentId, observation: Codec | None, action: Codec | None) -> Seat:
        """The seat of an agent that has none yet, with new columns where its spaces are new."""
        name = self._free(agent_name(agent))
        seat = Seat(
            len(self.order), agent, name,
            None if observation is None else self._side("obs", name, observation),
            None if action is None else self._side("action", name, action),
        )  # fmt: skip
        self.seats[agent] = seat
        self.order.append(seat)
        self._names.add(name)
        return seat

    def announce(
        self,
        agents: Sequence[AgentId],
        codecs: Callable[[AgentId], tuple[Codec | None, Codec | None]],
    ) -> None:
        """Seats all `agents` at once, so that columns are named after who differs from whom."""
        pairs = [(agent, *codecs(agent)) for agent in agents if agent not in self.seats]
        for kind, place in (("obs", 1), ("action", 2)):
            spaces = [(clean(str(p[0])), p[place]) for p in pairs if p[place] is not None]
            groups = group_names(spaces)
            for codec, group in groups.items():
                for leaf in codec.leaves:
                    rivals = {
                        other for each in groups for other in each.leaves if other.path == leaf.path
                    }
                    self._add(kind, leaf, f"@{group}" if len(rivals) > 1 else "")
        for agent, observation, action in pairs:
            self.seat(agent, observation, action)

    def take_state(self, codec: Codec | None) -> None:
        """Gives the environment's `state()` its columns, once its space is known."""
        self.state = None if codec is None else self._side("state", "", codec)

    def columns(self, kind: str) -> tuple[Column, ...]:
        """All columns of `kind` ("obs" or "action"), in the order in which they came."""
        return tuple(self._columns.get(kind, {}).values())

    def _free(self, name: str) -> str:
        """The name, or where another agent has it (0 and "0" do) the name with a sign behind it."""
        while name in self._names:
            name += "'"
        return name

    def _side(self, kind: str, agent: str, codec: Codec) -> Side:
        columns = tuple(self._column(kind, leaf, agent) for leaf in codec.leaves)
        return Side(codec, self._shared.setdefault(columns, columns))

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


def agent_name(agent: AgentId) -> str:
    """An agent's name in columns: itself where it is a text that UTF-8 carries, else its JSON."""
    if isinstance(agent, str) and clean(agent) == agent:
        return agent
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
        alone = len(prefixes[key]) == 1 and not prefixes[key] & others
        result[codec] = next(iter(prefixes[key])) if alone else names[0]
    return result


def role(agent: str) -> str:
    """The name of an agent without its number: `picker_0` is a `picker`."""
    head, _, tail = agent.rpartition("_")
    return head if head and tail.isdigit() else agent


def spaces_json(layout: Layout) -> dict[str, Mapping[str, object] | None]:
    """The spaces of every seat as plain JSON, by agent: `{"observation": ..., "action": ...}`."""
    return {
        seat.name: {
            "observation": None
            if seat.observation is None
            else space_to_json(seat.observation.codec.space),
            "action": None if seat.action is None else space_to_json(seat.action.codec.space),
        }
        for seat in layout.order
    }
