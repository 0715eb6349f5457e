"""Where two traces part: the first place, with both values."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.arrow import cells_of
from gamekeeper.core.block import Raw
from gamekeeper.core.canon import drop, from_json, to_json
from gamekeeper.core.difference import difference, shown_pair
from gamekeeper.core.extent import clipped, extent_of, is_open
from gamekeeper.core.leaf_columns import value_columns
from gamekeeper.core.legible import legible
from gamekeeper.core.trace import Trace, Turn


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first place where two traces differ.

    Attributes:
        episode: its number in the run.
        turn: the turn; None where the headers differ.
        agent: whose row; None where a whole turn or the state differs.
        field: `obs`, `obs.<path>`, `action`, `reward`, `received`, `terminated`, `truncated`,
            `info`, `mask`, `order`, `live`, `raised`, `odd`, `state`, `rows`, `digest`, or a field
            of the header.
        recorded: the value on the left.
        replayed: the value on the right.
    """

    episode: int
    turn: int | None
    agent: str | None
    field: str
    recorded: Any
    replayed: Any

    def to_json(self) -> dict[str, Any]:
        """Plain data; arrays as canonical JSON has them."""
        return {
            "episode": self.episode,
            "turn": self.turn,
            "agent": self.agent,
            "field": self.field,
            "recorded": json.loads(to_json(self.recorded)),
            "replayed": json.loads(to_json(self.replayed)),
        }

    def __str__(self) -> str:
        place = f"episode {self.episode}"
        if self.turn is not None:
            place += f", turn {self.turn}"
        key = f"{self.field}[{self.agent!r}]" if self.agent is not None else self.field
        recorded, replayed = shown_pair(self.recorded, self.replayed)
        return f"{place}, {key}\n  recorded: {recorded}\n  replayed: {replayed}"


@dataclass(frozen=True, slots=True)
class Comparison:
    """What comparing two traces came to.

    Attributes:
        divergence: the first place where they differ by more than the tolerance, if there is one.
        is_exact: they are equal bit for bit.
        largest: the largest difference of two numbers that was passed over as within tolerance.
    """

    divergence: Divergence | None
    is_exact: bool
    largest: float = 0.0


def compare(
    recorded: Trace,
    replayed: Trace,
    *,
    tolerance: float | None = None,
    volatile: Collection[str] = (),
) -> Comparison:
    """Compares two traces of one episode row by row.

    Args:
        recorded: may be at level "digest"; then the other's rows are digested for the comparison.
        tolerance: numbers that differ by no more, absolutely or relative to the larger one, count
            as equal; None: bit for bit.
        volatile: info fields that are left out.
    """
    known = clipped(replayed, extent_of(recorded))
    found = compare_rows(recorded, known, tolerance=tolerance, volatile=volatile)
    if found.divergence is not None:
        return found
    apart = compare_ends(recorded, replayed)
    return found if apart is None else Comparison(apart, is_exact=False, largest=found.largest)


def compare_rows(
    recorded: Trace, replayed: Trace, *, tolerance: float | None, volatile: Collection[str]
) -> Comparison:
    """Compares the turns of two traces, or of two stretches of the same turns; see `compare`."""
    largest, is_exact = 0.0, True
    walks = _Walk(recorded), _Walk(replayed)
    for number in _different_turns(recorded, replayed, volatile):
        is_exact = False
        turns = walks[0].at(number), walks[1].at(number)
        found, size = _first(recorded, replayed, number, turns, tolerance, volatile)
        largest = max(largest, size)
        if found is not None:
            return Comparison(found, is_exact=False, largest=largest)
    return Comparison(None, is_exact=is_exact, largest=largest)


def compare_ends(recorded: Trace, replayed: Trace) -> Divergence | None:
    """What the rules say of the ends of agents, where that differs."""
    if is_open(recorded.header) or recorded.endings == replayed.endings:
        return None
    values = dict(recorded.endings), dict(replayed.endings)
    return Divergence(recorded.episode, None, None, "endings", *values)


class _Walk:
    """The turns of a trace, asked for by rising numbers."""

    def __init__(self, trace: Trace) -> None:
        self._turns = trace.turns
        self._next = next(self._turns, None)

    def at(self, number: int) -> Turn | None:
        """The turn of this number, or None if no row has it."""
        while self._next is not None and self._next.index < number:
            self._next = next(self._turns, None)
        return self._next if self._next is not None and self._next.index == number else None


def _different_turns(left: Trace, right: Trace, volatile: Collection[str]) -> Iterator[int]:
    """The turns at which rows, infos or states differ, in their order."""
    if _are_equal(left, right):
        return
    sides = [_by_turn(trace, volatile) for trace in (left, right)]
    for turn in sorted(sides[0].keys() | sides[1].keys()):
        if sides[0].get(turn) != sides[1].get(turn):
            yield turn


@legible
def _are_equal(left: Trace, right: Trace) -> bool:
    """Whether all rows are the same, one by one: no look at each turn is needed then."""
    if left.steps.num_rows != right.steps.num_rows or (left.states is None) != (
        right.states is None
    ):
        return False
    for name in ("turn", "info"):
        if not left.steps[name].equals(right.steps[name]):
            return False
    if not np.array_equal(left.digests, right.digests):
        return False
    if left.states is None or right.states is None:
        return True
    return bool(left.states["turn"].equals(right.states["turn"])) and _states(
        left.states
    ) == _states(right.states)


@legible
def _by_turn(trace: Trace, volatile: Collection[str]) -> dict[int, list[Any]]:
    """For each turn, what has to be equal: digests of rows, infos, state."""
    found: dict[int, list[Any]] = {}
    columns = (
        trace.steps["turn"].to_pylist(),
        trace.digests,
        trace.steps["info"].to_pylist(),
    )
    for turn, digest, info in zip(*columns, strict=True):
        entry = found.setdefault(turn, [])
        entry.append(digest.tobytes())
        entry.append(_without(info, volatile))
    if trace.states is not None:
        for turn, state in zip(
            trace.states["turn"].to_pylist(), _states(trace.states), strict=True
        ):
            found.setdefault(turn, []).append(state)
    return found


def _states(states: pa.Table) -> list[Any]:
    parts: list[list[Any]] = [states["odd"].to_pylist()]
    for column in value_columns(states.schema, "state"):
        cells = cells_of(column, states[column.name])
        parts.append(
            [row.tobytes() for row in cells.values] if isinstance(cells, Raw) else cells.values
        )
    return list(zip(*parts, strict=True))


def _without(info: str | None, volatile: Collection[str]) -> Any:
    if info is None or not volatile:
        return info
    value = from_json(info)
    return to_json(drop(value, volatile)) if isinstance(value, dict) else info


def _first(
    left: Trace,
    right: Trace,
    number: int,
    turns: tuple[Turn | None, Turn | None],
    tolerance: float | None,
    volatile: Collection[str],
) -> tuple[Divergence | None, float]:
    """The first field of a turn that differs, and the largest difference passed over on the way."""
    a, b = turns
    names = [None if turn is None else list(turn.agents) for turn in turns]
    if names[0] != names[1]:
        errors = [
            None if turn is not None else _error(trace) for turn, trace in ((a, left), (b, right))
        ]
        if errors[0] != errors[1]:  # a reset raised, so there is no row that says it
            return Divergence(left.episode, number, None, "raised", *errors), 0.0
        return Divergence(left.episode, number, None, "rows", *names), 0.0
    largest = 0.0
    states = _states_at(left, number), _states_at(right, number)
    pairs = iter(()) if a is None or b is None else _pairs(a, b, volatile, _is_digest(left, right))
    for agent, field, recorded, replayed in chain(pairs, [(None, "state", *states)]):
        size = difference(recorded, replayed, None if _is_whole(field, recorded) else tolerance)
        if size is None:
            return Divergence(left.episode, number, agent, field, recorded, replayed), largest
        largest = max(largest, size)
    if a is not None and b is not None and (tolerance is None or _is_digest(left, right)):
        for agent, one, two in zip(a.agents, a.digests, b.digests, strict=True):
            if one != two:
                return Divergence(left.episode, number, agent, "digest", one, two), largest
    if tolerance is None:  # texts that spell equal values differently: no recorder wrote them
        return Divergence(left.episode, number, None, "rows", *names), largest
    return None, largest


def _is_digest(*traces: Trace) -> bool:
    return any("digest" in trace.steps.schema.names for trace in traces)


def _is_whole(field: str, value: Any) -> bool:
    """Whether no tolerance applies: action 2 isn't nearly action 3."""
    return field == "order" or (field == "action" and isinstance(value, int | np.integer))


def _error(trace: Trace) -> str | None:
    """The last line of what ended an episode: type and text of an exception."""
    text = trace.header.get("error")
    return text.strip().splitlines()[-1] if text and text.strip() else None


def _states_at(trace: Trace, number: int) -> Any:
    """`state()` at a turn; what didn't conform, as it was."""
    state = trace.state(number)
    if state is None and trace.states is not None:
        rows = trace.states.filter(pc.equal(trace.states["turn"], number))["odd"].to_pylist()
        entry = json.loads(rows[0])["state"] if rows and rows[0] is not None else None
        return from_json(json.dumps(entry["value"])) if entry and "value" in entry else entry
    return state


def _pairs(
    a: Turn, b: Turn, volatile: Collection[str], is_digest: bool
) -> Iterator[tuple[str | None, str, Any, Any]]:
    """Every field of two turns of the same rows, in the order in which it came about."""
    for agent in a.agents:
        if not is_digest:
            yield from _observations(agent, a.observations.get(agent), b.observations.get(agent))
        for field, one, two in (
            ("mask", _get(a.masks, agent), _get(b.masks, agent)),
            ("received", _get(a.received, agent), _get(b.received, agent)),
            ("terminated", _get(a.terminated, agent), _get(b.terminated, agent)),
            ("truncated", _get(a.truncated, agent), _get(b.truncated, agent)),
            ("info", _info(a, agent, volatile), _info(b, agent, volatile)),
            ("live", agent in a.live, agent in b.live),
            ("order", _place(a, agent), _place(b, agent)),
            ("action", _get(a.actions, agent), _get(b.actions, agent)),
            ("raised", _get(a.raised, agent), _get(b.raised, agent)),
            ("reward", _get(a.rewards, agent), _get(b.rewards, agent)),
            ("odd", _get(a.odd, agent), _get(b.odd, agent)),
        ):
            if not (is_digest and field == "mask"):
                yield agent, field, one, two
        paid = a.terms.get(agent, {}), b.terms.get(agent, {})
        for term in dict.fromkeys([*paid[0], *paid[1]]):
            yield agent, f"reward.{term}", paid[0].get(term), paid[1].get(term)


def _observations(
    agent: str, one: Any, two: Any, path: str = "obs"
) -> Iterator[tuple[str, str, Any, Any]]:
    """An observation leaf by leaf, so that the field names the part that differs."""
    joint = "." if path == "obs" else "/"
    if isinstance(one, dict) and isinstance(two, dict) and one.keys() == two.keys():
        for key in one:
            yield from _observations(agent, one[key], two[key], f"{path}{joint}{key}")
    elif isinstance(one, tuple) and isinstance(two, tuple) and len(one) == len(two):
        for place, (x, y) in enumerate(zip(one, two, strict=True)):
            yield from _observations(agent, x, y, f"{path}{joint}{place}")
    else:
        yield agent, path, one, two


def _get(mapping: Mapping[str, Any], agent: str) -> Any:
    return mapping.get(agent)


def _place(turn: Turn, agent: str) -> int | None:
    return turn.order.index(agent) if agent in turn.order else None


def _info(turn: Turn, agent: str, volatile: Collection[str]) -> Any:
    info = turn.infos.get(agent)
    return drop(info, volatile) if volatile and isinstance(info, dict) else info
