"""Traces: one episode as columns, and turns as read-only views of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.core.arrow import TERM, blocks_of
from gamekeeper.core.canon import from_json
from gamekeeper.core.decoding import (
    cells_by_column,
    mask_of,
    object_of,
    odd_of,
    payloads_at,
    places_of,
    value_at,
)
from gamekeeper.core.digest import SIZE, row_digests
from gamekeeper.core.legible import legible
from gamekeeper.core.space import Codec
from gamekeeper.core.where import Where

AgentName = str
MASK: Final = "action_mask"
_GIVEN: Final = ("terminated", "truncated", "received", "reward", "raised")
"""Columns that a turn has by agent, where they aren't null."""


@dataclass(frozen=True, slots=True)
class Spaces:
    """The codecs of one agent, from the spaces that its evidence names."""

    observation: Codec | None
    action: Codec | None


@dataclass(frozen=True, repr=False)
class Turn:
    """One turn of a trace: what agents were given, what they did, what that crossing paid them.

    Every mapping is by agent and holds only those that have such a value at this turn. `order`
    names those who acted, in their order; `live` those in the roster at the turn's start; `ended`
    those whose flags say terminated or truncated at the turn's start.
    """

    index: int
    agents: tuple[AgentName, ...]
    order: tuple[AgentName, ...]
    live: frozenset[AgentName]
    ended: frozenset[AgentName]
    received: Mapping[AgentName, float]
    terminated: Mapping[AgentName, bool]
    truncated: Mapping[AgentName, bool]
    rewards: Mapping[AgentName, float]
    raised: Mapping[AgentName, str]
    _trace: Trace
    _rows: range

    def __repr__(self) -> str:
        return (
            f"<Turn {self.index}: {', '.join(self.order) or 'nobody'} acted, {len(self.live)} live>"
        )

    @cached_property
    def observations(self) -> Mapping[AgentName, Any]:
        """What each agent observed, as its space has it; what didn't conform, as it was."""
        return self._trace._values(self, "obs")

    def has_observation(self, agent: AgentName) -> bool:
        """Whether the agent has an observation here; it isn't decoded for that."""
        return self._trace._has_observation(self, agent)

    @cached_property
    def actions(self) -> Mapping[AgentName, Any]:
        """What each agent did."""
        return self._trace._values(self, "action")

    @cached_property
    def infos(self) -> Mapping[AgentName, Any]:
        """The info that each agent was given; an empty dictionary where it was empty."""
        return self._trace._infos(self)

    @cached_property
    def masks(self) -> Mapping[AgentName, Any]:
        """The action mask that each agent was given, wherever it stood."""
        return self._trace._masks(self)

    @cached_property
    def terms(self) -> Mapping[AgentName, Mapping[str, float]]:
        """What the crossing paid each agent, by reward term."""
        return self._trace._terms(self._rows)

    @property
    def is_digest(self) -> bool:
        """Whether digests stand in place of the observations."""
        return self._trace.is_digest

    @cached_property
    def odd(self) -> Mapping[AgentName, Mapping[str, Any]]:
        """What didn't conform, by agent and field: its type's name and the value as it was."""
        return self._trace._odd(self._rows)

    @cached_property
    @legible
    def digests(self) -> tuple[bytes, ...]:
        """The digest of each row, as stored or computed from the row."""
        digests = self._trace.digests
        return tuple(digests[row].tobytes() for row in self._rows)

    @property
    def state(self) -> Any:
        """The environment's `state()` at the turn's start; None where it has none."""
        return self._trace.state(self.index)


@dataclass(frozen=True, repr=False)
class Trace:
    """One episode: its header and its columns.

    Attributes:
        episode: its number in the run.
        header: seed, since, options, policies, turns, end, error, endings, fingerprint.
        steps: the rows of the `steps` table, in the order turn, order, agent.
        states: the rows of the `states` table, or None.
        spaces: the codecs of each agent.
        state_codec: the codec of `state()`, where it was recorded.
        base: the run and episode of which this trace is a twin, if it is one.
        change: the one thing done differently in a twin.
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
        return (
            f"<Trace of episode {self.episode}, seed {self.seed}, {self.header.get('turns')} turns>"
        )

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
        """Of what type each agent's whole-number actions were: `int`, `numpy.int64`."""
        text = self.header.get("action_types")
        return {} if text is None else object_of(text)

    @property
    def is_digest(self) -> bool:
        """Whether digests stand in place of the observations."""
        return "digest" in self.steps.schema.names

    def at(self, turn: Turn | int | None, agent: AgentName | None = None, field: str = "") -> Where:
        """A place in this trace, as findings and errors name it."""
        number = turn.index if isinstance(turn, Turn) else turn
        return Where(self.header.get("probe", ""), self.episode, number, agent, field)

    def __len__(self) -> int:
        turns = self._list("turn")
        return turns[-1] + 1 if turns else 0

    @property
    @legible
    def digests(self) -> Any:
        """The digest of each row, [rows, 16], as stored or computed from the row, once."""
        return self._cached("digests", lambda: digests_of(self.steps))

    @property
    def turns(self) -> Iterator[Turn]:
        """The turns in their order; the last may hold closing rows only, given but not acted on."""
        kept = self._cache.get("turns")
        return self._walk() if kept is None else iter(kept)

    def keep_turns(self) -> None:
        """Keeps the turns once they are made, for the many who will read them."""
        self._cached("turns", lambda: list(self._walk()))

    def _walk(self) -> Iterator[Turn]:
        numbers, columns = self._list("turn"), self._columns()
        for number, group in groupby(range(len(numbers)), key=numbers.__getitem__):
            rows = list(group)
            yield self._turn(number, range(rows[0], rows[-1] + 1), columns)

    @legible
    def _columns(self) -> Mapping[str, list[Any]]:
        return {name: self._list(name) for name in ("agent", "order", "live", *_GIVEN)}

    @legible
    def _turn(self, number: int, rows: range, columns: Mapping[str, list[Any]]) -> Turn:
        names, order, live = columns["agent"], columns["order"], columns["live"]
        given = {
            name: {names[row]: values[row] for row in rows if values[row] is not None}
            for name, values in columns.items()
            if name in _GIVEN
        }
        acted = sorted((order[row], names[row]) for row in rows if order[row] is not None)
        flags = given["terminated"], given["truncated"]
        ended = {agent for each in flags for agent, flag in each.items() if flag}
        return Turn(
            index=number,
            agents=tuple([names[row] for row in rows]),
            order=tuple([name for _, name in acted]),
            live=frozenset([names[row] for row in rows if live[row]]),
            ended=frozenset(ended),
            received=MappingProxyType(given["received"]),
            rewards=MappingProxyType(given["reward"]),
            raised=MappingProxyType(given["raised"]),
            terminated=MappingProxyType(given["terminated"]),
            truncated=MappingProxyType(given["truncated"]),
            _trace=self,
            _rows=rows,
        )

    @legible
    def state(self, turn: int) -> Any:
        """The environment's `state()` at the start of `turn`; None where there is none."""
        if self.states is None:
            return None
        states = self.states
        rows = self._cached("state rows", lambda: places_of(states["turn"].to_pylist()))
        row = rows.get(turn)
        if row is None:
            return None
        cells = self._cached("state cells", lambda: cells_by_column(states, "state"))
        value = value_at(self.state_codec, cells, row)
        odd = states["odd"][row].as_py()
        return value if odd is None else odd_of(odd)["state"].get("value")

    # -- columns, decoded once and only when somebody looks

    def _cached(self, name: str, make: Any) -> Any:
        if name not in self._cache:
            self._cache[name] = make()
        return self._cache[name]

    def _list(self, name: str) -> list[Any]:
        return self._cached(name, lambda: self.steps[name].to_pylist())  # type: ignore[no-any-return]

    def _pick(self, rows: range, name: str) -> Mapping[AgentName, Any]:
        names, values = self._list("agent"), self._list(name)
        return MappingProxyType(
            {names[row]: values[row] for row in rows if values[row] is not None}
        )

    @legible
    def _values(self, turn: Turn, kind: str) -> Mapping[AgentName, Any]:
        cells = self._cached(f"cells {kind}", lambda: cells_by_column(self.steps, kind))
        names, odd = self._list("agent"), turn.odd
        found = {}
        for row in turn._rows:
            name = names[row]
            spaces = self.spaces.get(name)
            codec = (
                None if spaces is None else (spaces.observation if kind == "obs" else spaces.action)
            )
            value = value_at(codec, cells, row)
            strange = odd.get(name, {}).get(kind, {})
            if value is None:
                if "value" in strange:
                    found[name] = strange["value"]
                continue
            type_name = strange.get("type") or self.action_types.get(name)
            is_int = kind == "action" and isinstance(value, np.integer) and type_name == "int"
            found[name] = int(value) if is_int else value
        return MappingProxyType(found)

    @legible
    def _has_observation(self, turn: Turn, agent: AgentName) -> bool:
        """Whether `turn.observations` has the agent, without a look at what it is."""
        if agent not in turn.agents:
            return False
        cells = self._cached("cells obs", lambda: cells_by_column(self.steps, "obs"))
        spaces, row = self.spaces.get(agent), turn._rows[turn.agents.index(agent)]
        codec = None if spaces is None else spaces.observation
        if codec is not None and payloads_at(codec, cells, row) is not None:
            return True
        return "value" in turn.odd.get(agent, {}).get("obs", {})

    @legible
    def _infos(self, turn: Turn) -> Mapping[AgentName, Any]:
        names, infos, masks = self._list("agent"), self._list("info"), self._list("mask")
        received, odd = self._list("received"), turn.odd
        found = {}
        for row in turn._rows:
            name = names[row]
            if infos[row] is not None:
                info = from_json(infos[row])
                if masks[row] is not None and isinstance(info, dict):
                    info[MASK] = mask_of(info[MASK], masks[row])
                found[name] = info
            elif "info" in odd.get(name, {}):
                if "value" in odd[name]["info"]:
                    found[name] = odd[name]["info"]["value"]
            elif received[row] is not None or "received" in odd.get(name, {}):
                found[name] = {}
        return MappingProxyType(found)

    @legible
    def _masks(self, turn: Turn) -> Mapping[AgentName, Any]:
        found: dict[AgentName, Any] = {}
        for name in turn.agents:
            for place in (turn.observations.get(name), turn.infos.get(name)):
                if isinstance(place, dict) and MASK in place:
                    found.setdefault(name, place[MASK])
        return MappingProxyType(found)

    @legible
    def _terms(self, rows: range) -> Mapping[AgentName, Mapping[str, float]]:
        terms = [name for name in self.steps.schema.names if name.startswith(TERM)]
        found: dict[str, dict[str, float]] = {}
        for name in terms:
            for agent, value in self._pick(rows, name).items():
                found.setdefault(agent, {})[name[len(TERM) :]] = value
        return MappingProxyType(found)

    @legible
    def _odd(self, rows: range) -> Mapping[AgentName, Mapping[str, Any]]:
        names, odd = self._list("agent"), self._list("odd")
        return {names[row]: odd_of(odd[row]) for row in rows if odd[row] is not None}


def digests_of(steps: pa.Table) -> Any:
    """The digest of every row of a `steps` table, [rows, 16], as stored or else computed."""
    if "digest" in steps.schema.names:
        return np.frombuffer(b"".join(steps["digest"].to_pylist()), np.uint8).reshape(-1, SIZE)
    digests = [row_digests(block) for block in blocks_of(steps)]
    return np.concatenate(digests) if digests else np.empty((0, SIZE), np.uint8)
