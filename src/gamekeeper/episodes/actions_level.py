"""Level `actions`: what of whole rows a small run keeps, and the digest of that.

A row keeps agent, order, action, reward, flags, place in the roster, and whether its observation
was looked at. Witnesses are the rows of each `EVERY`th turn, the reset among them, and rows whose
agent has ended: one digest for those of a turn, which covers the whole rows and, at an `EVERY`th
turn, the state. All of it follows from whole turns alone, so a run of level `full` gives the same
rows, whoever took them down.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.episodes.block import (
    Block,
    Bytes2,
    Cells,
    Coded,
    Marks,
    Opener,
    Raw,
    States,
    Text,
    block_of,
    marks_of,
    side_cells,
)
from gamekeeper.episodes.buffer import BufferedTurns
from gamekeeper.episodes.digest import (
    DigestField,
    Hasher,
    cells_digest_field,
    digest_fields,
    names_digests,
    one_nan,
    row_digests,
    state_digests,
)
from gamekeeper.episodes.layout import Layout

EVERY: Final = 61
"""Turns from one witness to the next; a prime, so that agents in turn are witnesses in turn."""
WITNESS: Final = 4
"""Bytes of a turn's witness: a turn that came out otherwise has the same once in 4 billion."""
KEPT: Final = ("action", "reward", "terminated", "truncated")
"""Fields of a row whose nonconforming values are kept."""
_MISSING: Final = '"obs":{"type":"missing"}'
_ABSENT: Final = 255  # in place of a flag


# -- Whole rows become rows of the level


def kept_block(
    block: Block, states: States | None = None, *, hasher: Hasher | None = None
) -> Block:
    """Whole turns of `block` as level `actions` keeps them; of one that is so already, itself.

    Args:
        states: of the same turns, where the environment has any.
    """
    if block.witness is not None:
        return block
    return replace(
        block,
        values={name: each for name, each in block.values.items() if not name.startswith("obs")},
        mask=[None] * len(block),
        cumulative_reward=_nothing(len(block), 8),
        info=None,
        terms={},
        nonconforming=_kept_texts(block.nonconforming),
        observed=_observed(block),
        witness=_witnesses(block, states, hasher),
    )


def _witnesses(block: Block, states: States | None, hasher: Hasher | None) -> Raw:
    """The witness of each turn that has one, at its first row that is one."""
    found = _nothing(len(block), WITNESS)
    rows = np.flatnonzero(_are_witnesses(block))
    if not len(rows):
        return found
    digests = row_digests(rows_of(block, rows), hasher=hasher)
    keys = _keys(block, rows)
    firsts = np.flatnonzero(np.diff(keys, prepend=-1)).tolist()
    state_of = {} if states is None else _states_by_key(states, hasher)
    for first, end in zip(firsts, [*firsts[1:], len(rows)], strict=True):
        whole = digests[first:end].tobytes() + state_of.get(int(keys[first]), b"")
        found.valid[rows[first]] = True
        found.values[rows[first]] = list(blake2b(whole, digest_size=WITNESS).digest())
    return found


def _keys(part: Block | States, rows: NDArray[np.intp]) -> NDArray[np.int64]:
    return part.episode[rows].astype(np.int64) << 32 | part.turn[rows]


def _are_witnesses(block: Block) -> NDArray[np.bool_]:
    """[rows] whether the row is a witness."""
    found = block.turn % EVERY == 0
    for flag in (block.terminated, block.truncated):
        found |= flag.valid & flag.values[:, 0].astype(np.bool_)
    return np.asarray(found, np.bool_)


def _states_by_key(states: States, hasher: Hasher | None) -> dict[int, bytes]:
    """The digests of the states that witnesses cover."""
    rows = np.flatnonzero(states.turn % EVERY == 0)
    if not len(rows):
        return {}
    covered = States(
        states.episode[rows],
        states.turn[rows],
        [(column, _cells_of(cells, rows)) for column, cells in states.cells],
        [states.nonconforming[row] for row in rows.tolist()],
    )
    digests = state_digests(covered, hasher=hasher)
    keys = _keys(states, rows).tolist()
    return {key: each.tobytes() for key, each in zip(keys, digests, strict=True)}


def rows_of(block: Block, rows: NDArray[np.intp]) -> Block:
    """Some rows of a block."""
    places = rows.tolist()

    def part(items: Any) -> Any:
        if items is None:
            return None
        if isinstance(items, list):
            return [items[place] for place in places]
        if isinstance(items, Coded):
            return Coded(items.codes[rows], items.names)
        if isinstance(items, Raw | Text):
            return _cells_of(items, rows)
        return items.take(rows) if hasattr(items, "take") else items

    masks = block.mask
    return replace(
        block,
        **{name: getattr(block, name)[rows] for name in ("episode", "turn", "live")},
        **{name: part(getattr(block, name)) for name in _PARTS},
        values={name: (column, part(cells)) for name, (column, cells) in block.values.items()},
        terms={name: part(raw) for name, raw in block.terms.items()},
        mask={n: part(raw) for n, raw in masks.items()} if isinstance(masks, dict) else part(masks),
    )


_PARTS: Final = (
    "agent",
    "order",
    "cumulative_reward",
    "terminated",
    "truncated",
    "info",
    "reward",
    "raised",
    "nonconforming",
)


def _cells_of(cells: Cells, rows: NDArray[np.intp]) -> Any:
    if isinstance(cells, Raw):
        return Raw(cells.values[rows], cells.valid[rows])
    return Text([cells.values[row] for row in rows.tolist()])


def _nothing(count: int, size: int) -> Raw:
    return Raw(np.zeros((count, size), np.uint8), np.zeros(count, np.bool_))


def _observed(block: Block) -> NDArray[np.bool_]:
    """[rows] whether an observation was looked at, by what is there of it."""
    found = np.zeros(len(block), np.bool_)
    if block.observed is not None:  # those that weren't kept
        found |= block.observed
    for name, (_, cells) in block.values.items():
        if name.startswith("obs"):
            there = (
                cells.valid
                if isinstance(cells, Raw)
                else [each is not None for each in cells.values]
            )
            found |= there
    for row, text in enumerate(block.nonconforming or ()):
        if text is not None and '"obs":{' in text and _MISSING not in text:
            found[row] = True
    return found


def _kept_texts(texts: list[str | None] | None) -> list[str | None] | None:
    if texts is None or texts.count(None) == len(texts):
        return None
    found = [None if text is None else _kept_text(text) for text in texts]
    return None if found.count(None) == len(found) else found


def _kept_text(text: str) -> str | None:
    fields = {name: each for name, each in json.loads(text).items() if name in KEPT}
    return json.dumps(fields, separators=(",", ":"), ensure_ascii=False) if fields else None


# -- Buffered turns: usual rows stand in lists of their own


def kept_rows(
    buffered: BufferedTurns,
    layout: Layout,
    states: States | None,
    *,
    open_large: Opener,
    hasher: Hasher | None = None,
) -> Block | None:
    """The rows of `buffered`, usual and other, as level `actions` keeps them; None without any."""
    rest, marks = None, marks_of(buffered.turns)
    if buffered.given:
        rows = block_of(buffered, layout, open_large=open_large, marks=marks)
        rest = kept_block(rows, states, hasher=hasher)
    usual = _usual_block(buffered, layout, marks) if buffered.usual.agents else None
    if usual is None or rest is None:
        return usual or rest
    counts = marks[2]
    is_usual = np.repeat(counts < 0, np.abs(counts))
    return _merged(usual, np.flatnonzero(is_usual), rest, np.flatnonzero(~is_usual), layout)


def _usual_block(buffered: BufferedTurns, layout: Layout, marks: Marks) -> Block:
    episodes, turns, signed = marks
    counts, count = np.maximum(-signed, 0), len(buffered.usual.agents)
    index = np.fromiter(buffered.usual.agents, np.intp, count)
    # A row's place in its turn is its number less that of the turn's first row.
    first = np.repeat(np.cumsum(counts) - counts, counts)
    order = (np.arange(count) - first).astype(np.int16)
    yes, no = np.ones(count, np.bool_), np.zeros((count, 1), np.uint8)
    reward = np.fromiter(buffered.usual.rewards, np.float64, count)
    return Block(
        episode=np.repeat(episodes, counts),
        turn=np.repeat(turns, counts),
        agent=Coded(index.astype(np.int32), layout.names),
        order=Raw(order.view(np.uint8).reshape(count, 2), yes),
        values=side_cells(layout, index, buffered.usual.actions, "action"),
        mask=[None] * count,
        cumulative_reward=_nothing(count, 8),
        terminated=Raw(no, yes),
        truncated=Raw(no, yes),
        info=None,
        reward=Raw(reward.view(np.uint8).reshape(count, 8), yes),
        terms={},
        live=yes,
        raised=None,
        nonconforming=None,
        observed=yes,
        witness=_nothing(count, WITNESS),
    )


def _merged(
    one: Block, at: NDArray[np.intp], two: Block, then: NDArray[np.intp], layout: Layout
) -> Block:
    """Two blocks of the level as one, their rows at these places."""
    count, sides = len(at) + len(then), ((at, one), (then, two))

    def array(name: str) -> Any:
        a, b = getattr(one, name), getattr(two, name)
        whole = np.empty((count, *a.shape[1:]), a.dtype)
        whole[at], whole[then] = a, b
        return whole

    def raw(parts: list[tuple[NDArray[np.intp], Any]]) -> Raw:
        whole = _nothing(count, parts[0][1].values.shape[1])
        for rows, part in parts:
            whole.values[rows], whole.valid[rows] = part.values, part.valid
        return whole

    def texts(b: list[str | None] | None) -> list[str | None] | None:
        return None if b is None or b.count(None) == len(b) else _spread(count, [(then, b)])

    def cells(name: str) -> tuple[Any, Cells]:
        column = (one.values.get(name) or two.values[name])[0]
        there = [(rows, block.values[name][1]) for rows, block in sides if name in block.values]
        if isinstance(there[0][1], Text):
            return column, Text(_spread(count, [(rows, each.values) for rows, each in there]))
        return column, raw(there)

    names = layout.names
    codes = {name: code for code, name in enumerate(names)}
    agents = np.empty(count, np.int32)
    agents[at] = one.agent.codes  # type: ignore[union-attr]  # a usual block codes its agents
    agents[then] = [codes[name] for name in two.agent]  # type: ignore[union-attr]  # others don't
    raws = ("order", "terminated", "truncated", "reward", "witness")
    merged: dict[str, Any] = {
        n: raw([(rows, getattr(block, n)) for rows, block in sides]) for n in raws
    }
    return replace(
        one,
        **{name: array(name) for name in ("episode", "turn", "live", "observed")},
        **merged,
        agent=Coded(agents, names),
        cumulative_reward=_nothing(count, 8),
        values={name: cells(name) for name in {**one.values, **two.values}},
        mask=[None] * count,
        raised=texts(two.raised),
        nonconforming=texts(two.nonconforming),
    )


def _spread(count: int, parts: list[tuple[NDArray[np.intp], Any]]) -> list[Any]:
    whole: list[Any] = [None] * count
    for rows, items in parts:
        for row, item in zip(rows.tolist(), items, strict=True):
            whole[row] = item
    return whole


# -- The digest of rows of the level: of each one for comparisons, of an episode for its fingerprint


def kept_digests(block: Block) -> Bytes2:
    """The digest of what each row of level `actions` holds, [rows, 16]."""
    return digest_fields(
        [DigestField("row", "|u1", (), _table(block)), *_others(block)], len(block)
    )


def _table(block: Block) -> Bytes2:
    """The fields that every row has, as bytes [rows, 35]; an absent one by a mark of its own."""

    def flag(raw: Raw) -> Any:
        return np.where(raw.valid, raw.values[:, 0], _ABSENT)

    order, reward = block.order, block.reward
    # a field at a time as whole elements, as in digest: joining bytes takes five times as long
    table = np.empty(len(block), _ROW)
    table["turn"] = block.turn
    table["agent"] = names_digests(block.agent).view("V16")[:, 0]
    table["order"] = np.where(order.valid, order.values.view(np.int16)[:, 0], -1)
    table["terminated"], table["truncated"] = flag(block.terminated), flag(block.truncated)
    table["live"], table["observed"] = block.live, block.observed
    table["paid"] = reward.valid
    paid = np.ascontiguousarray(one_nan(reward.values, "<f8")).view("<u8")[:, 0]
    table["reward"] = np.where(reward.valid, paid, 0)
    return table.view(np.uint8).reshape(len(block), _ROW.itemsize)


_ROW: Final = np.dtype(
    [
        *(("turn", "<i4"), ("agent", "V16"), ("order", "<i2")),
        *((name, "u1") for name in ("terminated", "truncated", "live", "observed", "paid")),
        ("reward", "<u8"),
    ]
)
_KEY_BYTES: Final = 20  # of a row: its turn and agent


def _others(block: Block) -> Iterator[DigestField]:
    """The fields of some rows: actions, exceptions, undeclared values, digests of whole rows."""
    for column, cells in sorted(block.values.values(), key=lambda each: each[0].tag):
        yield cells_digest_field(column.tag, column.leaf.dtype, column.leaf.shape, cells)
    for name, texts in (("raised", block.raised), ("nonconforming", block.nonconforming)):
        if texts is not None:
            yield cells_digest_field(name, "", (), Text(texts))
    if block.witness is not None and block.witness.valid.any():
        yield DigestField("witness", "|u1", (WITNESS,), block.witness.values, block.witness.valid)


def _new() -> Any:
    return blake2b(digest_size=32)


@dataclass(slots=True)
class KeptDigest:
    """The running digest of one episode at level `actions`: a column at a time, not a row."""

    header: str
    _rows: Any = field(default_factory=_new)
    _columns: dict[str, Any] = field(default_factory=dict)

    def add_table(self, rows: Bytes2) -> None:
        """Takes the fields of every row, of rows that follow those taken before."""
        self._rows.update(rows)

    def add_column(self, tag: str, cells: Bytes2) -> None:
        """Takes the elements of one column, each after the number of its turn and its agent."""
        if tag not in self._columns:
            self._columns[tag] = _new()
        self._columns[tag].update(cells)

    @property
    def fingerprint(self) -> str:
        """Covers header and rows; 64 hexadecimal digits."""
        parts = [self.header.encode(), self._rows.digest()]
        for tag, column in sorted(self._columns.items()):
            parts += [tag.encode(), column.digest()]
        return blake2b(b"\0".join(parts), digest_size=32).hexdigest()

    @property
    def info_fingerprint(self) -> str:
        """Covers no infos, as none are kept; 64 hexadecimal digits."""
        return str(_new().hexdigest())


def add_kept(
    episodes: dict[int, KeptDigest],
    block: Block,
    each: Callable[[Any], Iterator[tuple[int, slice]]],
) -> None:
    """Adds the rows of `block` to the digests of their episodes.

    Args:
        each: the rows of each episode of a sorted column.
    """
    table = _table(block)
    for number, whole in each(block.episode):
        episodes[number].add_table(table[whole])
    for one in _others(block):
        rows: Any = (
            slice(None) if one.valid is None or one.valid.all() else np.flatnonzero(one.valid)
        )
        episode = block.episode[rows]
        if not len(episode):
            continue
        keys, values = np.ascontiguousarray(table[rows, :_KEY_BYTES]), one.values[rows]
        cells = np.empty(
            len(episode), [("key", f"V{_KEY_BYTES}"), ("value", f"V{values.shape[1]}")]
        )
        cells["key"] = keys.view(f"V{_KEY_BYTES}")[:, 0]
        if values.shape[1]:
            cells["value"] = np.ascontiguousarray(values).view(f"V{values.shape[1]}")[:, 0]
        head = f"{one.tag} {one.dtype} {list(one.shape)}"
        flat = cells.view(np.uint8).reshape(len(episode), cells.itemsize)
        for number, part in each(episode):
            episodes[number].add_column(head, flat[part])
