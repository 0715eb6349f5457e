"""A block: a range of rows as columns in memory, between buffer, digest and Arrow.

Every value column is raw bytes, one fixed-size element a row, so that rows are hashed and written
without looking at single values.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import repeat
from operator import is_not
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gamekeeper.episodes.buffer import (
    DONE,
    GIVEN,
    OBSERVED,
    TURN,
    BufferedTurns,
    EpisodeEnd,
    EpisodeStart,
    LargePlace,
)
from gamekeeper.episodes.layout import LARGE_BYTES, Column, Layout, length_of

Bytes2: TypeAlias = NDArray[np.uint8]
Texts: TypeAlias = list[str | None]
# copies an observation that was put aside (by its place) into one row of bytes
Opener: TypeAlias = Callable[[int, "NDArray[np.uint8]"], None]
Marks: TypeAlias = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]
BLOCK_BYTES: Final = 64 << 20  # of the values of one block; Arrow's offsets end at 2 GiB
LAST: Final = np.iinfo(np.int16).max  # sorts agents that did not act behind those that did


@dataclass(frozen=True, slots=True)
class Raw:
    """One column of fixed-size elements: `values` [rows, bytes], `valid` [rows]."""

    values: Bytes2
    valid: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Text:
    """One column of texts; None where there is none."""

    values: Texts


Cells: TypeAlias = "Raw | Text"


@dataclass(frozen=True, slots=True)
class Coded:
    """One column of names, `names[codes[row]]`."""

    codes: NDArray[np.int32]
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Block:
    """Rows in the order turn, order, agent. Every column has `len(episode)` elements.

    A kernel hands its columns over as they are: names by number, masks by their length, infos as
    an Arrow array, None for a column of texts without any. `observed` and `witness` are there at
    level `actions` alone, where observations aren't: [rows] whether the agent looked at one, and
    the digests of whole rows where they are kept.
    """

    episode: NDArray[np.int32]
    turn: NDArray[np.int32]
    agent: list[str] | Coded
    order: Raw
    values: dict[str, tuple[Column, Cells]]  # obs and action columns by name
    mask: list[bytes | None] | dict[int, Raw]
    cumulative_reward: Raw
    terminated: Raw
    truncated: Raw
    info: Texts | Any
    reward: Raw
    terms: dict[str, Raw]
    live: NDArray[np.bool_]
    raised: Texts | None
    nonconforming: Texts | None
    observed: NDArray[np.bool_] | None = None
    witness: Raw | None = None

    def __len__(self) -> int:
        return len(self.episode)


@dataclass(frozen=True, slots=True)
class States:
    """Values of `state()`, sorted by episode and turn; `nonconforming` as in `Block`."""

    episode: NDArray[np.int32]
    turn: NDArray[np.int32]
    cells: list[tuple[Column, Cells]]
    nonconforming: Texts


@dataclass(frozen=True, slots=True)
class Columns:
    """Whole turns as columns, episode by episode: the input of the encoder.

    Attributes:
        rows: of agents; None where there are none.
        steady_infos: infos of the rows without volatile fields, as an Arrow array; None: the
            encoder takes these fields out.
    """

    starts: list[EpisodeStart]
    rows: Block | None
    states: States | None
    ends: list[EpisodeEnd]
    steady_infos: Any = None


def columns_of(buffered: BufferedTurns, layout: Layout, *, open_large: Opener) -> Columns:
    """The turns of `buffered` as columns; `open_large` as in `block_of`."""
    rows = block_of(buffered, layout, open_large=open_large) if buffered.given else None
    return Columns(buffered.starts, rows, states_of(buffered, layout, open_large), buffered.ends)


def block_of(
    buffered: BufferedTurns, layout: Layout, *, open_large: Opener, marks: Marks | None = None
) -> Block:
    """The rows of `buffered` as columns, but for usual ones.

    Args:
        marks: as `marks_of` gives them, where they are known.
        open_large: writes the C bytes of an observation that was put aside into a row.
    """
    given, done = buffered.given, buffered.done
    agents: list[Any] = given[0::GIVEN]
    episodes, turns, counts = marks or marks_of(buffered.turns)
    counts = np.maximum(counts, 0)  # of rows that aren't usual
    episode, turn = np.repeat(episodes, counts), np.repeat(turns, counts)
    order = _numbers(done[0::DONE], np.int16)
    index = np.fromiter(agents, np.intp, len(agents))
    known = layout.names
    rows = _sorting(turn, episode, order, _ranks(index, known))
    pick = _picker(rows)
    paid: list[Any] = done[3::DONE]
    seen, observed = given[1::GIVEN], None
    if OBSERVED in seen:
        observed = _present(seen)[rows]
        seen = [None if each is OBSERVED else each for each in seen]
    # put in order before they become columns: those of images are copied once
    values = _sides(layout, index[rows], pick(seen), "obs", open_large)
    values |= _sides(layout, index[rows], pick(done[1::DONE]), "action", open_large)
    return Block(
        episode=episode[rows],
        turn=turn[rows],
        agent=pick([known[agent] for agent in agents]),
        order=_take(order, rows),
        values=values,
        mask=pick(given[2::GIVEN]),
        cumulative_reward=_take(_numbers(given[3::GIVEN], np.float64), rows),
        terminated=_take(_numbers(given[4::GIVEN], np.uint8), rows),
        truncated=_take(_numbers(given[5::GIVEN], np.uint8), rows),
        info=pick(given[6::GIVEN]),
        reward=_take(_numbers(done[2::DONE], np.float64), rows),
        terms={
            term: _take(_numbers([None if p is None else p[k] for p in paid], np.float64), rows)
            for k, term in enumerate(layout.terms)
        },
        live=np.array(given[7::GIVEN], np.bool_)[rows],
        raised=pick(done[4::DONE]),
        nonconforming=pick(_nonconforming(given[8::GIVEN], done[5::DONE])),
        observed=observed,
    )


def marks_of(turns: list[object]) -> Marks:
    """Episode, number and count of rows of each turn; usual rows count below 0."""
    count = len(turns) // TURN
    return (
        np.fromiter(turns[0::TURN], np.int32, count),
        np.fromiter(turns[1::TURN], np.int32, count),
        np.fromiter(turns[2::TURN], np.int64, count),
    )


def states_of(buffered: BufferedTurns, layout: Layout, open_large: Opener) -> States | None:
    """The states of `buffered` as columns; None where no turn has one."""
    count = len(buffered.turns) // TURN
    if all(buffered.turns[place::TURN].count(None) == count for place in (6, 7)):
        return None
    # a turn without a state leaves no row, or a digest would depend on the turns buffered with it
    every = zip(*(buffered.turns[place::TURN] for place in (0, 1, 6, 7)), strict=True)
    with_state = [marks for marks in every if marks[2:] != (None, None)]
    episodes, turns, payloads, nonconforming = (
        list[Any](column) for column in zip(*with_state, strict=True)
    )
    columns = layout.state.columns if layout.state is not None else ()
    parts = (
        [payloads]
        if len(columns) == 1
        else [[None if p is None else p[k] for p in payloads] for k in range(len(columns))]
    )
    cells = [
        (column, _column(column, part, open_large))
        for column, part in zip(columns, parts, strict=True)
    ]
    return States(np.array(episodes, np.int32), np.array(turns, np.int32), cells, nonconforming)


def _ranks(index: NDArray[np.intp], names: Sequence[str]) -> NDArray[np.int32]:
    """[rows] the place of each row's agent among the sorted names of the agents in the block."""
    present = np.unique(index).tolist()
    ranks = np.zeros(len(names), np.int32)
    ranks[sorted(present, key=names.__getitem__)] = np.arange(len(present))
    return ranks[index]


def _sorting(
    turn: NDArray[np.int32], episode: NDArray[np.int32], order: Raw, rank: NDArray[np.int32]
) -> NDArray[np.intp] | slice:
    """The rows by turn, order, agent; a slice of all where they stand so already."""
    place = np.where(order.valid, order.values.view(np.int16)[:, 0], LAST)
    same = (turn[1:] == turn[:-1]) & (episode[1:] == episode[:-1])
    earlier = (place[1:] < place[:-1]) | ((place[1:] == place[:-1]) & (rank[1:] < rank[:-1]))
    if not (same & earlier).any():
        return slice(None)
    # Turns are numbered as they stand, so that lexsort moves rows within their turn alone.
    start = np.cumsum(np.concatenate(([True], ~same))) if len(turn) else turn
    return np.lexsort((rank, place, start))


def _picker(rows: NDArray[np.intp] | slice) -> Callable[[Sequence[Any]], list[Any]]:
    if isinstance(rows, slice):
        return list
    places = rows.tolist()
    return lambda items: [items[place] for place in places]


def _take(cells: Raw, rows: NDArray[np.intp] | slice) -> Raw:
    return cells if isinstance(rows, slice) else Raw(cells.values[rows], cells.valid[rows])


def _numbers(items: Sequence[Any], dtype: type[Any]) -> Raw:
    """Numbers with None for null as raw elements of `dtype`."""
    array, valid = _whole(items, dtype), np.ones(len(items), np.bool_)
    if array is None:
        valid = _present(items)
        array = np.array([0 if item is None else item for item in items], dtype)
    return Raw(array.view(np.uint8).reshape(len(items), array.itemsize), valid)


def _whole(items: Sequence[Any], dtype: type[Any]) -> NDArray[Any] | None:
    """The numbers as they are; None where one of them is, or may be, None."""
    try:
        array = np.fromiter(items, dtype, len(items))
    except TypeError:  # to look for None first would cost as much again
        return None
    # a None that becomes a float becomes NaN
    return None if array.dtype.kind == "f" and np.isnan(array).any() else array


def _present(items: Sequence[Any]) -> NDArray[np.bool_]:
    """[items] which of them aren't None."""
    if None not in items:
        return np.ones(len(items), np.bool_)
    return np.fromiter(map(is_not, items, repeat(None)), np.bool_, len(items))


def _nonconforming(given: list[Any], done: list[Any]) -> Texts:
    """The nonconforming fields of rows, one JSON object each; None where there are none."""
    count = len(given)
    if given.count(None) == count and done.count(None) == count:
        return [None] * count
    parts = [(*(a or ()), *(b or ())) for a, b in zip(given, done, strict=True)]
    # each part is a text `"field":{...}`; they stand in the order of fields
    return ["{" + ",".join(sorted(each)) + "}" if each else None for each in parts]


def side_cells(
    layout: Layout, index: NDArray[np.intp], payloads: list[Any], kind: str
) -> dict[str, tuple[Column, Cells]]:
    """Payloads of one kind, none of them put aside, as columns; `index` is each row's agent."""
    return _sides(layout, index, payloads, kind, _not_aside)


def _not_aside(place: int, out: Bytes2) -> None:
    raise AssertionError("an action is put aside")


def _sides(
    layout: Layout, index: NDArray[np.intp], payloads: list[Any], kind: str, open_large: Opener
) -> dict[str, tuple[Column, Cells]]:
    """Payloads of one kind as columns; a row is null in the columns that aren't its agent's."""
    groups = layout.groups(kind)
    column_rows: dict[str, tuple[Column, list[tuple[Any, list[Any]]]]] = {}
    for columns, members in groups:
        if len(groups) == 1:
            rows, mine = None, payloads
        else:
            rows = np.flatnonzero(members[index])
            mine = [payloads[row] for row in rows.tolist()]
        for place, column in enumerate(columns):
            parts = mine if len(columns) == 1 else [None if p is None else p[place] for p in mine]
            column_rows.setdefault(column.name, (column, []))[1].append((rows, parts))
    return {
        name: (column, _cells(column, parts, len(payloads), open_large))
        for name, (column, parts) in column_rows.items()
    }


def _cells(
    column: Column, parts: list[tuple[Any, list[Any]]], count: int, open_large: Opener
) -> Cells:
    if len(parts) == 1 and parts[0][0] is None:
        return _column(column, parts[0][1], open_large)
    if column.leaf.kind in ("text", "json"):
        texts: Texts = [None] * count
        for rows, payloads in parts:
            for row, payload in zip(rows.tolist(), payloads, strict=True):
                texts[row] = payload
        return Text(texts)
    values = np.zeros((count, element_bytes(column)), np.uint8)
    valid = np.zeros(count, np.bool_)
    for rows, payloads in parts:
        raw = _column(column, payloads, open_large)
        assert isinstance(raw, Raw)  # for the type checker: text and json are done above
        values[rows], valid[rows] = raw.values, raw.valid
    return Raw(values, valid)


def _column(column: Column, payloads: list[Any], open_large: Opener) -> Cells:
    kind = column.leaf.kind
    if kind in ("text", "json"):
        return Text(payloads)
    if kind == "int":
        return _numbers(payloads, np.int64)
    size = element_bytes(column)
    valid = _present(payloads)
    if size >= LARGE_BYTES:
        return Raw(_large(payloads, size, open_large), valid)
    if not valid.all():
        blank = bytes(size)
        payloads = [blank if p is None else p for p in payloads]
    return Raw(np.frombuffer(b"".join(payloads), np.uint8).reshape(len(payloads), size), valid)


def _large(payloads: list[Any], size: int, open_large: Opener) -> Bytes2:
    values = np.zeros((len(payloads), size), np.uint8)
    for row, payload in zip(values, payloads, strict=True):
        if payload.__class__ is LargePlace:
            open_large(payload, row)
        elif payload is not None:
            row[:] = np.frombuffer(payload, np.uint8)
    return values


def most_rows(columns: Iterable[Column], rows: int = 65_536, size_bytes: int | None = None) -> int:
    """Number of rows of these columns that take `size_bytes`; at most `rows`, and at least one."""
    sizes = (
        element_bytes(column) for column in columns if column.leaf.kind not in ("text", "json")
    )
    return max(1, min(rows, (size_bytes or BLOCK_BYTES) // max(1, sum(sizes))))


def element_bytes(column: Column) -> int:
    """The size of one element of a fixed-size column, in bytes."""
    if column.leaf.kind == "int":
        return 8
    return length_of(column.leaf) * np.dtype(column.leaf.dtype).itemsize
