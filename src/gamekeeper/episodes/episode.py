"""Episodes as columns, and turns as read-only views of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.actions_level import kept_block, kept_digests
from gamekeeper.episodes.arrow import TERM, blocks_of, cells_of, steps_batch
from gamekeeper.episodes.block import Cells, Raw, States
from gamekeeper.episodes.canonical import from_json
from gamekeeper.episodes.digest import SIZE, row_digests
from gamekeeper.episodes.layout import Column, value_columns
from gamekeeper.episodes.plain_json import legible
from gamekeeper.episodes.spaces import Codec
from gamekeeper.episodes.views import Views
from gamekeeper.episodes.where import Where
from gamekeeper.errors import EvidenceError

# scalars that canonical JSON writes as plain values
_SCALARS: Final[dict[str | None, Any]] = {
    "numpy.bool": np.bool_,
    "numpy.bool_": np.bool_,
    "numpy.int64": np.int64,
    "numpy.float64": np.float64,
    "numpy.str_": np.str_,
}


def cells_by_column(table: pa.Table, kind: str) -> list[tuple[Column, Cells]]:
    """The columns of a table that hold leaves of `kind`, with what is in them."""
    return [
        (column, cells_of(column, table[column.name]))
        for column in value_columns(table.schema, kind)
    ]


def value_at(codec: Codec | None, cells: list[tuple[Column, Cells]], row: int) -> Any:
    """One value from the columns that hold the leaves of `codec`, or None where they are null."""
    payloads = payloads_at(codec, cells, row)
    return None if codec is None or payloads is None else codec.unpack(payloads)


def payloads_at(
    codec: Codec | None, cells: list[tuple[Column, Cells]], row: int
) -> tuple[Any, ...] | None:
    """The payloads of one value, leaf by leaf; None without a codec, or where one is null."""
    payloads = []
    for leaf in () if codec is None else codec.leaves:
        found = (_payload(column, each, row) for column, each in cells if column.leaf == leaf)
        payload = next(found, None)
        if payload is None:
            return None
        payloads.append(payload)
    return None if codec is None else tuple(payloads)


def _payload(column: Column, cells: Cells, row: int) -> Any:
    if not isinstance(cells, Raw):
        return cells.values[row]
    if not cells.valid[row]:
        return None
    payload = cells.values[row].tobytes()
    return int.from_bytes(payload, "little", signed=True) if column.leaf.kind == "int" else payload


def mask_of(text: str, payload: bytes) -> Any:
    """An action mask from its dtype and shape, as `int8 5`, and its bytes."""
    dtype, _, shape = text.partition(" ")
    return np.frombuffer(payload, dtype).reshape([int(n) for n in shape.split("x") if n]).copy()


def object_of(text: str) -> dict[str, Any]:
    """A JSON object from its text.

    Raises:
        ValueError: it is something else.
    """
    found = json.loads(text)
    if not isinstance(found, dict):
        raise ValueError(f"{text[:40]!r} is no JSON object")
    return found


def nonconforming_of(text: str) -> dict[str, Any]:
    """The nonconforming fields of a row: the name of a type, and the value where there is one."""
    fields = object_of(text)
    for entry in fields.values():
        if "value" in entry:
            value = from_json(json.dumps(entry["value"]))
            scalar = _SCALARS.get(entry.get("type"))
            is_plain = isinstance(value, bool | int | float | str)
            entry["value"] = scalar(value) if scalar is not None and is_plain else value
    return fields


AgentName = str
MASK: Final = "action_mask"
_GIVEN: Final = ("terminated", "truncated", "cumulative_reward", "reward", "raised")
"""Columns that a turn has by agent, where they aren't null."""


@dataclass(frozen=True, slots=True)
class Spaces:
    """The codecs of one agent, from the spaces that its evidence names."""

    observation: Codec | None
    action: Codec | None

    def of(self, kind: str) -> Codec | None:
        """The codec of `kind`: "obs" or "action"."""
        return self.observation if kind == "obs" else self.action


_NO_SPACES: Final = Spaces(None, None)


@dataclass(frozen=True, repr=False)
class Turn:
    """One turn of an episode: values that agents were given, their actions, and their rewards.

    Every mapping is by agent and holds only those that have such a value at this turn. `order`
    names the agents that acted, in their order; `live` those in the roster at the turn's start;
    `ended` those whose flags say terminated or truncated at the turn's start.
    """

    index: int
    agents: tuple[AgentName, ...]
    order: tuple[AgentName, ...]
    live: frozenset[AgentName]
    ended: frozenset[AgentName]
    cumulative_reward: Mapping[AgentName, float]
    terminated: Mapping[AgentName, bool]
    truncated: Mapping[AgentName, bool]
    rewards: Mapping[AgentName, float]
    raised: Mapping[AgentName, str]
    _episode: Episode
    _rows: range

    def __repr__(self) -> str:
        acted = f"{', '.join(self.order)} acted" if self.order else "without actions"
        return f"<Turn {self.index}: {acted}, {len(self.live)} live>"

    def row(self, agent: AgentName) -> int:
        """The place of an agent's row in the columns of the episode."""
        return self._rows[self.agents.index(agent)]

    @cached_property
    def observations(self) -> Mapping[AgentName, Any]:
        """Observation of each agent, as its space has it; one that didn't conform, as it was."""
        return self._values("obs")

    @legible
    def has_observation(self, agent: AgentName) -> bool:
        """True if the agent has an observation here; it isn't decoded for that."""
        if agent not in self.agents:
            return False
        codec = self._episode.spaces.get(agent, _NO_SPACES).observation
        payloads = payloads_at(codec, self._episode.cells("obs"), self.row(agent))
        return payloads is not None or "value" in self._strange(agent, "obs")

    @cached_property
    def actions(self) -> Mapping[AgentName, Any]:
        """Action of each agent."""
        return self._values("action")

    @cached_property
    @legible
    def infos(self) -> Mapping[AgentName, Any]:
        """The info that each agent was given; an empty dictionary where it was empty."""
        infos, masks, rewards = map(
            self._episode.column, ("info", "action_mask", "cumulative_reward")
        )
        found: dict[AgentName, Any] = {}
        for name, row in zip(self.agents, self._rows, strict=True):
            nonconforming = self.nonconforming.get(name, {})
            if infos[row] is not None:
                info: Any = from_json(infos[row])
                if masks[row] is not None and isinstance(info, dict):
                    info[MASK] = mask_of(info[MASK], masks[row])
                found[name] = info
            elif "info" in nonconforming:
                if "value" in nonconforming["info"]:
                    found[name] = nonconforming["info"]["value"]
            elif rewards[row] is not None or "cumulative_reward" in nonconforming:
                found[name] = {}  # an empty info leaves null: the agent was given something here
        return MappingProxyType(found)

    @cached_property
    def masks(self) -> Mapping[AgentName, Any]:
        """The action mask that each agent was given, wherever it stood."""
        found: dict[AgentName, Any] = {}
        for name in self.agents:
            for place in (self.observations.get(name), self.infos.get(name)):
                if isinstance(place, dict) and MASK in place:
                    found.setdefault(name, place[MASK])
        return MappingProxyType(found)

    @cached_property
    @legible
    def terms(self) -> Mapping[AgentName, Mapping[str, float]]:
        """Reward that the step paid each agent, by reward term."""
        found: dict[str, dict[str, float]] = {}
        for column in self._episode.steps.schema.names:
            if column.startswith(TERM):
                values = self._episode.column(column)
                for name, row in zip(self.agents, self._rows, strict=True):
                    if values[row] is not None:
                        found.setdefault(name, {})[column[len(TERM) :]] = values[row]
        return MappingProxyType(found)

    @cached_property
    @legible
    def nonconforming(self) -> Mapping[AgentName, Mapping[str, Any]]:
        """Values that didn't conform, by agent and field: the name of the type, and the value."""
        texts = self._episode.column("nonconforming")
        return {
            name: nonconforming_of(texts[row])
            for name, row in zip(self.agents, self._rows, strict=True)
            if texts[row] is not None
        }

    @cached_property
    @legible
    def digests(self) -> tuple[bytes, ...]:
        """The digest of each row, as stored or computed from the row."""
        return tuple(digest.tobytes() for digest in self._episode.digests[self._rows])

    @property
    def state(self) -> Any:
        """The environment's `state()` at the turn's start; None where it has none."""
        return self._episode.state(self.index)

    def _strange(self, agent: AgentName, field: str) -> Mapping[str, Any]:
        """Type and value of a field that didn't conform; empty where it did."""
        return self.nonconforming.get(agent, {}).get(field) or {}

    @legible
    def _values(self, kind: str) -> Mapping[AgentName, Any]:
        cells, types = self._episode.cells(kind), self._episode.action_types
        found = {}
        for name, row in zip(self.agents, self._rows, strict=True):
            value = value_at(self._episode.spaces.get(name, _NO_SPACES).of(kind), cells, row)
            strange = self._strange(name, kind)
            if value is None:
                if "value" in strange:
                    found[name] = strange["value"]
                continue
            # a column of whole numbers gives numpy's: an action comes back as the type it was
            type_name = strange.get("type") or types.get(name)
            is_int = kind == "action" and isinstance(value, np.integer) and type_name == "int"
            found[name] = int(value) if is_int else value
        return MappingProxyType(found)


@dataclass(frozen=True, repr=False)
class Episode:
    """One episode: its header and its columns.

    Attributes:
        episode: its number in the run.
        header: seed, since, options, policies, turns, end, error, endings, fingerprint.
        steps: the rows of the `steps` table, in the order turn, order, agent.
        states: the rows of the `states` table, or None.
        spaces: the codecs of each agent.
        state_codec: the codec of `state()`, where it was recorded.
        base: the run and episode of which this one is a counterfactual, if it is one.
        change: the one thing done differently in a counterfactual.
    """

    episode: int
    header: Mapping[str, Any]
    steps: pa.Table
    states: pa.Table | None
    spaces: Mapping[AgentName, Spaces]
    state_codec: Codec | None = None
    base: str | None = None
    change: Mapping[str, Any] | None = None
    _cache: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"<Episode {self.episode}: seed {self.seed}, {self.header.get('turns')} turns>"

    @property
    def seed(self) -> int | None:
        """The seed of its reset; None where it ran on from the last seeded one."""
        return self.header.get("seed")

    @property
    @legible
    def options(self) -> Any:
        """The options of its reset."""
        text = self.header.get("options")
        return None if text is None else from_json(text)

    @property
    @legible
    def endings(self) -> Mapping[AgentName, str]:
        """Reasons of endings by agent, where the environment's rules name them."""
        text = self.header.get("endings")
        return {} if text is None else object_of(text)

    @cached_property
    @legible
    def action_types(self) -> Mapping[AgentName, str]:
        """Type of each agent's whole-number actions: `int`, `numpy.int64`."""
        text = self.header.get("action_types")
        return {} if text is None else object_of(text)

    @property
    def is_digest(self) -> bool:
        """True if digests stand in place of the observations."""
        return "digest" in self.steps.schema.names

    @property
    def is_actions(self) -> bool:
        """True if it keeps only actions, rewards and flags, and the digests of some rows."""
        return "observed" in self.steps.schema.names

    @legible
    def kept(self) -> Episode:
        """The episode as level `actions` keeps it; itself where it is kept so."""
        if self.is_actions:
            return self
        states = None if self.states is None else states_of_table(self.states)
        batches = [steps_batch(kept_block(block, states)) for block in blocks_of(self.steps)]
        steps = pa.Table.from_batches(batches) if batches else self.steps
        return replace(self, steps=steps, states=None, _cache={})

    def at(self, turn: Turn | int | None, agent: AgentName | None = None, field: str = "") -> Where:
        """A place in this episode, as findings and errors name it."""
        turn = turn.index if isinstance(turn, Turn) else turn
        return Where(self.header.get("probe", ""), self.episode, turn, agent, field)

    def __len__(self) -> int:
        turns = self.column("turn")
        return turns[-1] + 1 if turns else 0

    @property
    @legible
    def digests(self) -> Any:
        """The digest of each row, [rows, 16], as stored or computed from the row, once."""
        return self._cached("digests", lambda: digests_of(self.steps))

    @property
    def turns(self) -> Sequence[Turn]:
        """The turns in their order; the last may hold closing rows only, given but not acted on."""
        kept: Sequence[Turn] | None = self._cache.get("turns")
        return self._views() if kept is None else kept

    def keep_turns(self) -> None:
        """Keeps the turns once they are made, for many readers."""
        self._cached("turns", lambda: tuple(self._views()))

    @legible
    def column(self, name: str) -> list[Any]:
        """A column of `steps` as a list, decoded once."""
        return self._cached(name, lambda: self.steps[name].to_pylist())  # type: ignore[no-any-return]

    def cells(self, kind: str) -> list[tuple[Column, Cells]]:
        """The columns that hold leaves of `kind` ("obs" or "action"), decoded once."""
        return self._cached(f"cells {kind}", lambda: cells_by_column(self.steps, kind))  # type: ignore[no-any-return]

    @legible
    def _views(self) -> Views[Turn]:
        numbers = self.column("turn")
        columns = {name: self.column(name) for name in ("agent", "order", "live", *_GIVEN)}
        firsts = self._cached(
            "first rows", lambda: [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist()]
        )
        ends = [*firsts[1:], len(numbers)]
        return Views(
            len(firsts) if numbers else 0,
            lambda at: self._turn(numbers[firsts[at]], range(firsts[at], ends[at]), columns),
        )

    @legible
    def _turn(self, number: int, rows: range, columns: Mapping[str, list[Any]]) -> Turn:
        names, order, live = columns["agent"], columns["order"], columns["live"]
        given = {
            name: {names[row]: columns[name][row] for row in rows if columns[name][row] is not None}
            for name in _GIVEN
        }
        acted = sorted((order[row], names[row]) for row in rows if order[row] is not None)
        flags = given["terminated"], given["truncated"]
        return Turn(
            index=number,
            agents=tuple([names[row] for row in rows]),
            order=tuple([name for _, name in acted]),
            live=frozenset([names[row] for row in rows if live[row]]),
            ended=frozenset([agent for each in flags for agent, flag in each.items() if flag]),
            cumulative_reward=MappingProxyType(given["cumulative_reward"]),
            rewards=MappingProxyType(given["reward"]),
            raised=MappingProxyType(given["raised"]),
            terminated=MappingProxyType(given["terminated"]),
            truncated=MappingProxyType(given["truncated"]),
            _episode=self,
            _rows=rows,
        )

    @legible
    def state(self, turn: int) -> Any:
        """The environment's `state()` at the start of `turn`; None where there is none."""
        if self.states is None:
            return None
        states = self.states
        places = self._cached(
            "state rows", lambda: {at: row for row, at in enumerate(states["turn"].to_pylist())}
        )
        row = places.get(turn)
        if row is None:
            return None
        nonconforming = states["nonconforming"][row].as_py()
        if nonconforming is not None:
            return nonconforming_of(nonconforming)["state"].get("value")
        cells = self._cached("state cells", lambda: cells_by_column(states, "state"))
        return value_at(self.state_codec, cells, row)

    def _cached(self, name: str, make: Callable[[], Any]) -> Any:
        if name not in self._cache:
            self._cache[name] = make()
        return self._cache[name]


def states_of_table(states: pa.Table) -> States:
    """A `states` table as columns in memory."""
    states = states.combine_chunks()
    turns = np.ascontiguousarray(states["turn"].to_numpy())
    cells, texts = cells_by_column(states, "state"), states["nonconforming"].to_pylist()
    return States(states["episode"].to_numpy(), turns, cells, texts)


def digests_of(steps: pa.Table) -> Any:
    """The digest of every row of a `steps` table, [rows, 16], as stored or else computed.

    Raises:
        EvidenceError: a stored one isn't of 16 bytes.
    """
    is_actions = "observed" in steps.schema.names
    if not is_actions and "digest" in steps.schema.names:
        stored = steps["digest"]
        if stored.null_count or pc.any(pc.not_equal(pc.binary_length(stored), SIZE)).as_py():
            raise EvidenceError(
                f"the digest of a row isn't of {SIZE} bytes",
                where="agent_steps, digest",
                fix="restore the run from a copy; `gamekeeper verify` lists all damage",
            )
        return np.frombuffer(b"".join(stored.to_pylist()), np.uint8).reshape(-1, SIZE)
    digests = list(map(kept_digests if is_actions else row_digests, blocks_of(steps)))
    return np.concatenate(digests) if digests else np.empty((0, SIZE), np.uint8)
