"""Rows of a buffer, in their order: which there are, where their values stand, and those values."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.vector.kernel_buffer import KernelBuffer, TickBuffer, TurnBuffer, group_of

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
            ("episode", "i4"),
            ("turn", "i4"),
            ("agent", "i4"),
            ("slot", "i4"),
            ("order", "i2"),
            ("has_order", "?"),
            ("given", "?"),
            ("acted", "?"),
            ("flagged", "?"),
            ("live", "?"),
            ("is_paid", "?"),
            ("has_terms", "?"),
            ("terminated", "?"),
            ("truncated", "?"),
            ("source", "i8"),
            ("action", "i8"),
            ("cumulative_reward", "f8"),
            ("reward", "f8"),
            ("terms", "f8", (terms,)),
        ]
    )


def rows_of(buffer: KernelBuffer, *, is_last: bool) -> NDArray[Any]:
    """The rows of a buffer in the order episode, turn, order, agent.

    Args:
        buffer: since it was carried on.
        is_last: what is given now gets rows, too, that nobody answers.
    """
    parts = _tick_rows(buffer, is_last) if isinstance(buffer, TickBuffer) else []
    if isinstance(buffer, TurnBuffer):
        parts = _turn_rows(buffer, is_last)
    kind = parts[0].dtype
    # as bytes: rows are copied whole, not field by field
    whole = np.concatenate([part.view(f"V{kind.itemsize}") for part in parts])
    return whole[_sorted(whole.view(kind), 2 * buffer.agents)].view(kind)


def _sorted(rows: NDArray[Any], slots: int) -> NDArray[np.intp]:
    """Order of the rows; no two have the same key."""
    if not len(rows):
        return np.zeros(0, np.intp)
    episode, turn = rows["episode"].astype(np.int64), rows["turn"].astype(np.int64)
    episode -= episode.min()
    turns = int(turn.max()) + 1
    if (int(episode.max()) + 1) * turns * slots >= SPAN:
        return np.lexsort((rows["slot"], turn, episode))
    return np.argsort((episode * turns + turn) * slots + rows["slot"])


def _ranks(buffer: KernelBuffer) -> NDArray[np.int32]:
    """[agent] its place among the names: those who didn't act stand in that order, behind."""
    names = buffer.kernel.agents
    ranks = np.zeros(len(names), np.int32)
    ranks[sorted(range(len(names)), key=names.__getitem__)] = np.arange(len(names))
    return ranks + len(names)


def _new(buffer: KernelBuffer, count: int) -> NDArray[Any]:
    return np.zeros(count, row_type(buffer.batch.arrays.terms.shape[2]))


def _apart(buffer: KernelBuffer, name: str) -> NDArray[Any]:
    parts = buffer.apart.rows.get(name)
    return np.zeros(0, np.int32) if parts is None else np.concatenate(parts)


# -- all at once


def _tick_rows(buffer: TickBuffer, is_last: bool) -> list[NDArray[Any]]:
    given, filled, agents = buffer.given, buffer.filled, buffer.agents
    slots = filled + is_last
    is_open = given["open"][:slots, :, None]
    present = given["present"][:slots] & is_open
    has_row = present.copy()
    paid = buffer.done["rewards"][:filled]
    has_row[:filled] |= (paid != 0.0) & is_open[:filled]
    flat = np.flatnonzero(has_row)
    moment, agent = np.divmod(flat, agents)
    rows = _new(buffer, len(flat))

    def of(array: NDArray[Any]) -> Any:
        return array[:slots].reshape(-1)[flat]

    is_given = present.reshape(-1)[flat]
    answered = moment < filled * buffer.copies
    live = of(given["live"]) & is_given
    order = (np.cumsum(given["live"][:slots], axis=2) - 1).reshape(-1)[flat]
    acted = live & answered
    rows["episode"] = given["episode"][:slots].reshape(-1)[moment]
    rows["turn"] = given["clock"][:slots].reshape(-1)[moment]
    rows["agent"], rows["order"], rows["source"], rows["action"] = agent, order, flat, flat
    rows["has_order"] = rows["acted"] = acted
    rows["given"] = rows["flagged"] = is_given
    rows["live"] = live
    rows["slot"] = np.where(acted, order, _ranks(buffer)[agent])
    for name, kept in (
        ("cumulative_reward", "cumulative_reward"),
        ("terminated", "ended"),
        ("truncated", "cut"),
    ):
        rows[name] = of(given[kept])
    rows["is_paid"] = acted | ~is_given
    rows["has_terms"] = answered
    last = np.where(answered, flat, 0)
    rows["reward"] = buffer.done["rewards"].reshape(-1)[last]
    rows["terms"] = buffer.done["terms"].reshape(-1, rows["terms"].shape[1])[last]
    return [rows, _closing(buffer, (buffer.slots + 1) * buffer.copies * agents)]


def _closing(buffer: KernelBuffer, dense: int) -> NDArray[Any]:
    """Last observations of agents that lived to the end."""
    agent = _apart(buffer, "agent")
    rows = _new(buffer, len(agent))
    for name in ("episode", "turn", "cumulative_reward", "terminated", "truncated"):
        rows[name] = _apart(buffer, name)
    rows["agent"] = agent
    rows["slot"] = _ranks(buffer)[agent]
    rows["given"] = rows["flagged"] = True
    rows["source"] = dense + np.arange(len(agent))
    return rows


# -- in turn


def _turn_rows(buffer: TurnBuffer, is_last: bool) -> list[NDArray[Any]]:
    given, filled = buffer.given, buffer.filled
    slots = filled + is_last
    if is_last:
        actor = given["turn"][filled]
        given["cumulative_reward"][filled] = buffer.sums[buffer.everybody, actor]
    moment = np.flatnonzero(given["open"][:slots])
    agent = given["turn"][:slots].reshape(-1)[moment].astype(np.int64)
    rows = _new(buffer, len(moment))
    answered = moment < filled * buffer.copies
    _place(buffer, rows, moment, agent, answered)
    rows["source"] = rows["action"] = moment
    rows["cumulative_reward"] = given["cumulative_reward"].reshape(-1)[moment]
    rows["has_order"] = rows["acted"] = rows["is_paid"] = rows["has_terms"] = answered
    rows["given"] = rows["live"] = True
    rows["slot"] = np.where(answered, NOT_ACTED, _ranks(buffer)[agent])
    return [rows, _touched(buffer, slots), _last_turns(buffer), _news(buffer)]


def _place(
    buffer: TurnBuffer, rows: NDArray[Any], moment: Any, agent: NDArray[Any], answered: Any
) -> None:
    """When it is, whose row, and what the turn paid."""
    rows["episode"] = buffer.given["episode"].reshape(-1)[moment]
    rows["turn"] = buffer.given["clock"].reshape(-1)[moment]
    rows["agent"], rows["flagged"] = agent, True
    at = np.where(answered, moment, 0)
    rows["reward"] = buffer.done["rewards"].reshape(-1, buffer.agents)[at, agent]
    count = rows["terms"].shape[1]
    rows["terms"] = buffer.done["terms"].reshape(-1, buffer.agents, count)[at, agent]


def _touched(buffer: TurnBuffer, slots: int) -> NDArray[Any]:
    """Those who didn't act, and were paid or came."""
    given, filled = buffer.given, buffer.filled
    has_row = given["news"][:slots].copy()
    has_row[:filled] |= buffer.done["rewards"][:filled] != 0.0
    has_row &= given["open"][:slots, :, None]
    has_row &= given["turn"][:slots, :, None] != np.arange(buffer.agents)
    flat = np.flatnonzero(has_row)
    moment, agent = np.divmod(flat, buffer.agents)
    rows = _new(buffer, len(flat))
    answered = moment < filled * buffer.copies
    _place(buffer, rows, moment, agent, answered)
    rows["live"] = given["live"][:slots].reshape(-1)[flat]
    rows["slot"] = _ranks(buffer)[agent]
    rows["is_paid"] = answered & (rows["reward"] != 0.0)
    rows["has_terms"] = True
    rest = ~answered
    rows["terms"][rest] = buffer.terms[moment[rest] % buffer.copies, agent[rest]]
    return rows


def _last_turns(buffer: TurnBuffer) -> NDArray[Any]:
    """The turns in which those who ended can do nothing."""
    rows = _closing(buffer, (buffer.slots + 1) * buffer.copies)
    rows["live"] = rows["has_order"] = rows["has_terms"] = True
    rows["slot"] = NOT_ACTED
    return rows


def _news(buffer: TurnBuffer) -> NDArray[Any]:
    """Others who ended or came, at the first of these turns."""
    agent = _apart(buffer, "light_agent")
    rows = _new(buffer, len(agent))
    for name in ("episode", "turn", "terminated", "truncated"):
        rows[name] = _apart(buffer, f"light_{name}")
    rows["agent"] = agent
    rows["slot"] = _ranks(buffer)[agent]
    rows["flagged"] = rows["live"] = rows["has_terms"] = True
    return rows


# -- their values


def given_values(buffer: KernelBuffer, name: str, rows: NDArray[Any]) -> NDArray[Any]:
    """Values in the array of that name for rows of its group, [rows, ...]."""
    whole = buffer.given[name]
    axes = 2 if buffer.kernel.api == "aec" else 3
    dense = whole.reshape(-1, *whole.shape[axes:])
    source = _in_group(buffer, rows["source"], rows["agent"], name, len(dense))
    parts = buffer.apart.rows.get(name)
    if parts is None:
        return dense[source]
    is_apart = source >= len(dense)
    found = dense[np.where(is_apart, 0, source)]
    found[is_apart] = np.concatenate(parts)[source[is_apart] - len(dense)]
    return found


def done_values(buffer: KernelBuffer, name: str, rows: NDArray[Any]) -> NDArray[Any]:
    """The actions of rows of a group, [rows, ...]; anything where none was taken."""
    whole = buffer.done[name]
    axes = 2 if buffer.kernel.api == "aec" else 3
    dense = whole.reshape(-1, *whole.shape[axes:])
    place = np.where(rows["acted"], rows["action"], 0)
    agent = np.where(rows["acted"], rows["agent"], 0)
    if buffer.kernel.api == "parallel" and len(buffer.kernel.groups) > 1:
        group = buffer.kernel.groups[group_of(name)]
        place = (place // buffer.agents) * group.count + np.maximum(agent - group.first, 0)
    return dense[np.where(rows["acted"], place, 0)]


def _in_group(
    buffer: KernelBuffer, source: NDArray[np.int64], agent: NDArray[Any], name: str, dense: int
) -> NDArray[np.int64]:
    """Places within the arrays of one group; those apart come behind its own buffer."""
    if buffer.kernel.api == "aec" or len(buffer.kernel.groups) == 1 or name == "infos":
        return source
    group = buffer.kernel.groups[group_of(name)]
    whole = (buffer.slots + 1) * buffer.copies * buffer.agents
    inside: NDArray[np.int64] = (source // buffer.agents) * group.count + agent - group.first
    is_apart = source >= whole
    if is_apart.any():
        others = _apart(buffer, "agent")
        mine = (others >= group.first) & (others < group.first + group.count)
        inside[is_apart] = dense + (np.cumsum(mine) - 1)[source[is_apart] - whole]
    return inside
