"""Rows of a tape, in their order: which there are, where their values stand, and those values."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.vector.kernel_tape import Tape, group_of
from gamekeeper.vector.kernel_ticks import TickTape
from gamekeeper.vector.kernel_turns import TurnTape

SPAN: Final = 1 << 62
NOT_ACTED: Final = 0


def row_type(terms: int) -> np.dtype[Any]:
    """One row: whose, when, and where its values stand.

    `slot` sorts the rows of a turn. `source` is the place of what was given: in the buffers, or
    behind them in what stands apart. `action` is the place of what was done in the buffers. Flags
    say which of the values there are.
    """
    return np.dtype(
        [
            ("episode", "i4"), ("turn", "i4"), ("agent", "i4"), ("slot", "i4"), ("order", "i2"),
            ("has_order", "?"), ("given", "?"), ("acted", "?"), ("flagged", "?"), ("live", "?"),
            ("is_paid", "?"), ("has_terms", "?"), ("terminated", "?"), ("truncated", "?"),
            ("source", "i8"), ("action", "i8"), ("received", "f8"), ("reward", "f8"),
            ("terms", "f8", (terms,)),
        ]
    )  # fmt: skip


def rows_of(tape: Tape, *, is_last: bool) -> NDArray[Any]:
    """The rows of a tape in the order episode, turn, order, agent.

    Args:
        tape: since it was carried on.
        is_last: what is given now gets rows, too, that nobody answers.
    """
    parts = _tick_rows(tape, is_last) if isinstance(tape, TickTape) else []
    if isinstance(tape, TurnTape):
        parts = _turn_rows(tape, is_last)
    kind = parts[0].dtype
    # as bytes: rows are copied whole, not field by field
    whole = np.concatenate([part.view(f"V{kind.itemsize}") for part in parts])
    return whole[_sorted(whole.view(kind), 2 * tape.agents)].view(kind)


def _sorted(rows: NDArray[Any], slots: int) -> NDArray[np.intp]:
    """Where the rows stand, in their order; no two have the same key."""
    if not len(rows):
        return np.zeros(0, np.intp)
    episode, turn = rows["episode"].astype(np.int64), rows["turn"].astype(np.int64)
    episode -= episode.min()
    turns = int(turn.max()) + 1
    if (int(episode.max()) + 1) * turns * slots >= SPAN:
        return np.lexsort((rows["slot"], turn, episode))
    return np.argsort((episode * turns + turn) * slots + rows["slot"])


def _ranks(tape: Tape) -> NDArray[np.int32]:
    """[agent] its place among the names: those who didn't act stand in that order, behind."""
    names = tape.kernel.agents
    ranks = np.zeros(len(names), np.int32)
    ranks[sorted(range(len(names)), key=names.__getitem__)] = np.arange(len(names))
    return ranks + len(names)


def _new(tape: Tape, count: int) -> NDArray[Any]:
    return np.zeros(count, row_type(tape.batch.arrays.terms.shape[2]))


def _apart(tape: Tape, name: str) -> NDArray[Any]:
    parts = tape.apart.rows.get(name)
    return np.zeros(0, np.int32) if parts is None else np.concatenate(parts)


# -- all at once


def _tick_rows(tape: TickTape, is_last: bool) -> list[NDArray[Any]]:
    given, filled, agents = tape.given, tape.filled, tape.agents
    slots = filled + is_last
    is_open = given["open"][:slots, :, None]
    present = given["present"][:slots] & is_open
    has_row = present.copy()
    paid = tape.done["rewards"][:filled]
    has_row[:filled] |= (paid != 0.0) & is_open[:filled]
    flat = np.flatnonzero(has_row)
    moment, agent = np.divmod(flat, agents)
    rows = _new(tape, len(flat))

    def of(array: NDArray[Any]) -> Any:
        return array[:slots].reshape(-1)[flat]

    is_given = present.reshape(-1)[flat]
    answered = moment < filled * tape.copies
    live = of(given["live"]) & is_given
    order = (np.cumsum(given["live"][:slots], axis=2) - 1).reshape(-1)[flat]
    acted = live & answered
    rows["episode"] = given["episode"][:slots].reshape(-1)[moment]
    rows["turn"] = given["clock"][:slots].reshape(-1)[moment]
    rows["agent"], rows["order"], rows["source"], rows["action"] = agent, order, flat, flat
    rows["has_order"] = rows["acted"] = acted
    rows["given"] = rows["flagged"] = is_given
    rows["live"] = live
    rows["slot"] = np.where(acted, order, _ranks(tape)[agent])
    for name, kept in (("received", "received"), ("terminated", "ended"), ("truncated", "cut")):
        rows[name] = of(given[kept])
    rows["is_paid"] = acted | ~is_given
    rows["has_terms"] = answered
    last = np.where(answered, flat, 0)
    rows["reward"] = tape.done["rewards"].reshape(-1)[last]
    rows["terms"] = tape.done["terms"].reshape(-1, rows["terms"].shape[1])[last]
    return [rows, _closing(tape, (tape.slots + 1) * tape.copies * agents)]


def _closing(tape: Tape, dense: int) -> NDArray[Any]:
    """What those who lived to the end were given last."""
    agent = _apart(tape, "agent")
    rows = _new(tape, len(agent))
    for name in ("episode", "turn", "received", "terminated", "truncated"):
        rows[name] = _apart(tape, name)
    rows["agent"] = agent
    rows["slot"] = _ranks(tape)[agent]
    rows["given"] = rows["flagged"] = True
    rows["source"] = dense + np.arange(len(agent))
    return rows


# -- in turn


def _turn_rows(tape: TurnTape, is_last: bool) -> list[NDArray[Any]]:
    given, filled = tape.given, tape.filled
    slots = filled + is_last
    if is_last:
        actor = given["turn"][filled]
        given["received"][filled] = tape.sums[tape.everybody, actor]
    moment = np.flatnonzero(given["open"][:slots])
    agent = given["turn"][:slots].reshape(-1)[moment].astype(np.int64)
    rows = _new(tape, len(moment))
    answered = moment < filled * tape.copies
    _place(tape, rows, moment, agent, answered)
    rows["source"] = rows["action"] = moment
    rows["received"] = given["received"].reshape(-1)[moment]
    rows["has_order"] = rows["acted"] = rows["is_paid"] = rows["has_terms"] = answered
    rows["given"] = rows["live"] = True
    rows["slot"] = np.where(answered, NOT_ACTED, _ranks(tape)[agent])
    return [rows, _touched(tape, slots), _last_turns(tape), _news(tape)]


def _place(
    tape: TurnTape, rows: NDArray[Any], moment: Any, agent: NDArray[Any], answered: Any
) -> None:
    """When it is, whose row, and what the turn paid."""
    rows["episode"] = tape.given["episode"].reshape(-1)[moment]
    rows["turn"] = tape.given["clock"].reshape(-1)[moment]
    rows["agent"], rows["flagged"] = agent, True
    at = np.where(answered, moment, 0)
    rows["reward"] = tape.done["rewards"].reshape(-1, tape.agents)[at, agent]
    count = rows["terms"].shape[1]
    rows["terms"] = tape.done["terms"].reshape(-1, tape.agents, count)[at, agent]


def _touched(tape: TurnTape, slots: int) -> NDArray[Any]:
    """Those who didn't act, and were paid or came."""
    given, filled = tape.given, tape.filled
    has_row = given["news"][:slots].copy()
    has_row[:filled] |= tape.done["rewards"][:filled] != 0.0
    has_row &= given["open"][:slots, :, None]
    has_row &= given["turn"][:slots, :, None] != np.arange(tape.agents)
    flat = np.flatnonzero(has_row)
    moment, agent = np.divmod(flat, tape.agents)
    rows = _new(tape, len(flat))
    answered = moment < filled * tape.copies
    _place(tape, rows, moment, agent, answered)
    rows["live"] = given["live"][:slots].reshape(-1)[flat]
    rows["slot"] = _ranks(tape)[agent]
    rows["is_paid"] = answered & (rows["reward"] != 0.0)
    rows["has_terms"] = True
    rest = ~answered
    rows["terms"][rest] = tape.terms[moment[rest] % tape.copies, agent[rest]]
    return rows


def _last_turns(tape: TurnTape) -> NDArray[Any]:
    """The turns in which those who ended can do nothing."""
    rows = _closing(tape, (tape.slots + 1) * tape.copies)
    rows["live"] = rows["has_order"] = rows["has_terms"] = True
    rows["slot"] = NOT_ACTED
    return rows


def _news(tape: TurnTape) -> NDArray[Any]:
    """Others who ended or came, at the first of these turns."""
    agent = _apart(tape, "light_agent")
    rows = _new(tape, len(agent))
    for name in ("episode", "turn", "terminated", "truncated"):
        rows[name] = _apart(tape, f"light_{name}")
    rows["agent"] = agent
    rows["slot"] = _ranks(tape)[agent]
    rows["flagged"] = rows["live"] = rows["has_terms"] = True
    return rows


# -- their values


def given_values(tape: Tape, name: str, rows: NDArray[Any]) -> NDArray[Any]:
    """What stands in the array of that name for rows of its group, [rows, ...]."""
    whole = tape.given[name]
    axes = 2 if tape.kernel.api == "aec" else 3
    dense = whole.reshape(-1, *whole.shape[axes:])
    source = _in_group(tape, rows["source"], rows["agent"], name, len(dense))
    parts = tape.apart.rows.get(name)
    if parts is None:
        return dense[source]
    is_apart = source >= len(dense)
    found = dense[np.where(is_apart, 0, source)]
    found[is_apart] = np.concatenate(parts)[source[is_apart] - len(dense)]
    return found


def done_values(tape: Tape, name: str, rows: NDArray[Any]) -> NDArray[Any]:
    """The actions of rows of a group, [rows, ...]; anything where none was taken."""
    whole = tape.done[name]
    axes = 2 if tape.kernel.api == "aec" else 3
    dense = whole.reshape(-1, *whole.shape[axes:])
    place = np.where(rows["acted"], rows["action"], 0)
    agent = np.where(rows["acted"], rows["agent"], 0)
    if tape.kernel.api == "parallel" and len(tape.kernel.groups) > 1:
        group = tape.kernel.groups[group_of(name)]
        place = (place // tape.agents) * group.count + np.maximum(agent - group.first, 0)
    return dense[np.where(rows["acted"], place, 0)]


def _in_group(
    tape: Tape, source: NDArray[np.int64], agent: NDArray[Any], name: str, dense: int
) -> NDArray[np.int64]:
    """Places within the arrays of one group; those apart come behind its own buffer."""
    if tape.kernel.api == "aec" or len(tape.kernel.groups) == 1 or name == "infos":
        return source
    group = tape.kernel.groups[group_of(name)]
    whole = (tape.slots + 1) * tape.copies * tape.agents
    inside: NDArray[np.int64] = (source // tape.agents) * group.count + agent - group.first
    is_apart = source >= whole
    if is_apart.any():
        others = _apart(tape, "agent")
        mine = (others >= group.first) & (others < group.first + group.count)
        inside[is_apart] = dense + (np.cumsum(mine) - 1)[source[is_apart] - whole]
    return inside
