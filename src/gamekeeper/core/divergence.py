"""Where two traces part: the first place, with both values."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.arrow import cells_of, value_columns
from gamekeeper.core.block import Raw
from gamekeeper.core.canon import drop, from_json, to_json
from gamekeeper.core.trace import Trace, Turn, digests_of


# of an episode whose recorder was killed nothing is known after its last whole turn
ENDS_OPEN: Final = ("torn", "failed")


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first place where two traces differ.

    Attributes:
        episode: its number in the run.
        turn: the turn; None where the headers differ.
        agent: whose row; None where a whole turn or the state differs.
        field: `obs`, `obs.<path>`, `action`, `reward`, `received`, `terminated`, `truncated`, `info`,
            `mask`, `order`, `live`, `raised`, `odd`, `state`, `rows`, `digest`, or a field of the header.
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
        return f"{place}, {key}\n  recorded: {_short(self.recorded)}\n  replayed: {_short(self.replayed)}"


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
        tolerance: numbers that differ by no more, absolutely or relative to the larger one, count as
            equal; None: bit for bit.
        volatile: info fields that are left out.
    """
    replayed = _as_far_as(recorded, replayed)
    largest = 0.0
    for place in _different_turns(recorded, replayed, volatile):
        found, size = _first(recorded, replayed, place, tolerance, volatile)
        largest = max(largest, size)
        if found is not None:
            return Comparison(found, is_exact=False, largest=largest)
        if tolerance is None:
            raise AssertionError(f"digests differ at turn {place} but no field does")
    return Comparison(None, is_exact=largest == 0.0 and _same_digests(recorded, replayed), largest=largest)


def _as_far_as(recorded: Trace, replayed: Trace) -> Trace:
    """`replayed` without what came after the end of a recording that was torn off."""
    turns = recorded.header.get("turns")
    last = recorded.steps["turn"][-1].as_py() if recorded.steps.num_rows else -1
    if recorded.header.get("end") not in ENDS_OPEN or turns is None or last >= turns:
        return replayed
    steps = replayed.steps.filter(pc.less(replayed.steps["turn"], turns))
    states = replayed.states
    if states is not None and recorded.states is not None:
        kept = recorded.states["turn"][-1].as_py() if recorded.states.num_rows else -1
        states = states.filter(pc.less_equal(states["turn"], kept))
    return replace(replayed, steps=steps, states=states, _cache={})


def _same_digests(left: Trace, right: Trace) -> bool:
    return bool(np.array_equal(digests_of(left.steps), digests_of(right.steps)))


def _different_turns(left: Trace, right: Trace, volatile: Collection[str]) -> Iterator[int]:
    """The turns at which rows, infos or states differ, in their order."""
    sides = [_by_turn(trace, volatile) for trace in (left, right)]
    for turn in sorted(sides[0].keys() | sides[1].keys()):
        if sides[0].get(turn) != sides[1].get(turn):
            yield turn


def _by_turn(trace: Trace, volatile: Collection[str]) -> dict[int, list[Any]]:
    """For each turn, what has to be equal: digests of rows, infos, state."""
    found: dict[int, list[Any]] = {}
    columns = trace.steps["turn"].to_pylist(), digests_of(trace.steps), trace.steps["info"].to_pylist()
    for turn, digest, info in zip(*columns, strict=True):
        entry = found.setdefault(turn, [])
        entry.append(digest.tobytes())
        entry.append(_without(info, volatile))
    if trace.states is not None:
        for turn, state in zip(trace.states["turn"].to_pylist(), _states(trace.states), strict=True):
            found.setdefault(turn, []).append(state)
    return found


def _states(states: pa.Table) -> list[Any]:
    parts: list[list[Any]] = [states["odd"].to_pylist()]
    for column in value_columns(states.schema, "state"):
        cells = cells_of(column, states[column.name])
        parts.append([row.tobytes() for row in cells.values] if isinstance(cells, Raw) else cells.values)
    return list(zip(*parts, strict=True))


def _without(info: str | None, volatile: Collection[str]) -> Any:
    if info is None or not volatile:
        return info
    value = from_json(info)
    return to_json(drop(value, volatile)) if isinstance(value, dict) else info


def _first(
    left: Trace, right: Trace, number: int, tolerance: float | None, volatile: Collection[str]
) -> tuple[Divergence | None, float]:
    """The first field of a turn that differs, and the largest difference passed over on the way."""
    sides = [_turn(trace, number) for trace in (left, right)]
    a, b = sides
    if a is None or b is None:
        rows = [None if side is None else list(side.agents) for side in sides]
        return Divergence(left.episode, number, None, "rows", *rows), 0.0
    if a.agents != b.agents:
        return Divergence(left.episode, number, None, "rows", list(a.agents), list(b.agents)), 0.0
    largest = 0.0
    for agent, field, recorded, replayed in _pairs(a, b, volatile, left):
        size = _difference(recorded, replayed, tolerance)
        if size is None:
            return Divergence(left.episode, number, agent, field, recorded, replayed), largest
        largest = max(largest, size)
    return None, largest


def _turn(trace: Trace, number: int) -> Turn | None:
    return next((turn for turn in trace.turns if turn.index == number), None)


def _pairs(
    a: Turn, b: Turn, volatile: Collection[str], left: Trace
) -> Iterator[tuple[str | None, str, Any, Any]]:
    """Every field of two turns that stand for the same rows, in the order in which it came about."""
    is_digest = "digest" in left.steps.schema.names
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
            ("reward", _get(a.rewards, agent), _get(b.rewards, agent)),
            ("raised", _get(a.raised, agent), _get(b.raised, agent)),
            ("odd", _get(a.odd, agent), _get(b.odd, agent)),
        ):
            if not (is_digest and field == "mask"):
                yield agent, field, one, two
        for term in a.terms.get(agent, {}):
            yield agent, f"reward.{term}", a.terms[agent][term], b.terms.get(agent, {}).get(term)
    yield None, "state", a.state, b.state
    if is_digest:
        for agent, one, two in zip(a.agents, a.digests, b.digests, strict=True):
            yield agent, "digest", one, two


def _observations(agent: str, one: Any, two: Any, path: str = "obs") -> Iterator[tuple[str, str, Any, Any]]:
    """An observation leaf by leaf, so that the field names the part that differs."""
    if isinstance(one, dict) and isinstance(two, dict) and one.keys() == two.keys():
        for key in one:
            joint = "." if path == "obs" else "/"
            yield from _observations(agent, one[key], two[key], f"{path}{joint}{key}")
    else:
        yield agent, path, one, two


def _get(mapping: Mapping[str, Any], agent: str) -> Any:
    return mapping.get(agent)


def _place(turn: Turn, agent: str) -> int | None:
    return turn.order.index(agent) if agent in turn.order else None


def _info(turn: Turn, agent: str, volatile: Collection[str]) -> Any:
    info = turn.infos.get(agent)
    return drop(info, volatile) if volatile and isinstance(info, dict) else info


def _difference(one: Any, two: Any, tolerance: float | None) -> float | None:
    """How far apart two values are: 0.0 if equal, None if further than `tolerance` or of another kind."""
    if to_json(one) == to_json(two):
        return 0.0
    if tolerance is None:
        return None
    if isinstance(one, dict) and isinstance(two, dict) and one.keys() == two.keys():
        return _largest([_difference(one[key], two[key], tolerance) for key in one])
    if isinstance(one, list | tuple) and isinstance(two, list | tuple) and len(one) == len(two):
        return _largest([_difference(x, y, tolerance) for x, y in zip(one, two, strict=True)])
    try:
        a, b = np.asarray(one, np.float64), np.asarray(two, np.float64)
    except (TypeError, ValueError):
        return None
    if a.shape != b.shape:
        return None
    with np.errstate(invalid="ignore"):
        gap = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b))
        within = gap <= tolerance * np.maximum(1.0, np.maximum(np.abs(a), np.abs(b)))
    return float(gap.max(initial=0.0)) if bool(within.all()) else None


def _largest(sizes: list[float | None]) -> float | None:
    return None if None in sizes else max((size for size in sizes if size is not None), default=0.0)


def _short(value: Any) -> str:
    text = to_json(value)
    return text if len(text) <= 200 else f"{text[:197]}..."
