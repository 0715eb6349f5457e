"""The rows of a tape as batches of Arrow columns, each row with its digest."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
import pyarrow as pa
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.core.arrow import cells_field, steps_batch
from gamekeeper.core.block import Block, Cells, Coded, Raw
from gamekeeper.core.digest import row_digests
from gamekeeper.core.layout import Column, Layout, Side
from gamekeeper.core.press import state_digests
from gamekeeper.kernels.hashing import row_digests as hashed
from gamekeeper.kernels.kernel import MASK
from gamekeeper.vector.kernel_rows import done_values, given_values, rows_of
from gamekeeper.vector.kernel_tape import Tape
from gamekeeper.vector.kernel_texts import info_texts, mask_texts

DIGEST, TEXT = "digest", "info without"
"""Columns that episodes' fingerprints are made of; the second one isn't written."""


class KernelPress:
    """Makes columns of what a tape holds.

    Args:
        tape: of the batch.
        layout: of the environment: columns by agent.
        terms: reward terms by name, as the contract has them.
        volatile: info fields that stay out of the info fingerprint.
    """

    def __init__(
        self, tape: Tape, layout: Layout, *, terms: tuple[str, ...], volatile: Collection[str]
    ) -> None:
        self._tape, self._kernel, self._layout = tape, tape.kernel, layout
        self._terms, self._volatile = terms, volatile
        self._seats = [layout.seats[agent] for agent in self._kernel.agents]

    def steps(self, *, is_last: bool, level: str) -> pa.RecordBatch | None:
        """The rows, sorted, with a digest each; at level `digest` without observations."""
        rows = rows_of(self._tape, is_last=is_last)
        if not len(rows):
            return None
        block, texts = self._block(rows)
        digests = row_digests(block, hasher=hashed)
        batch = steps_batch(block, digests=digests if level == "digest" else None)
        if level != "digest":
            data = pa.py_buffer(np.ascontiguousarray(digests))
            kind = pa.binary(digests.shape[1])
            whole = pa.Array.from_buffers(kind, len(rows), [None, data])
            batch = batch.append_column(DIGEST, whole)
        return batch if texts is None else batch.append_column(TEXT, texts)

    def states(self, *, is_last: bool) -> pa.RecordBatch | None:
        """The state at each turn, with a digest each, sorted by episode and turn."""
        tape, side = self._tape, self._layout.state
        if "state" not in tape.given or side is None:
            return None
        slots = tape.filled + is_last
        moment = np.flatnonzero(tape.given["open"][:slots])
        apart = {name: np.concatenate(parts) for name, parts in tape.apart.states.items()}

        def whole(name: str, of: str) -> NDArray[Any]:
            array = tape.given[of][:slots]
            dense = array.reshape(-1, *array.shape[2:])[moment]
            return np.concatenate([dense, apart[name]]) if apart else dense

        episode, turn = whole("episode", "episode"), whole("turn", "clock")
        order = np.lexsort((turn, episode))
        episode, turn = episode[order], np.ascontiguousarray(turn[order])
        if not len(episode):
            return None
        column = side.columns[0]
        values = _bytes(column, whole("state", "state")[order])
        cells: list[tuple[Column, Cells]] = [(column, Raw(values, np.ones(len(turn), bool)))]
        digests = state_digests(turn, cells, [None] * len(turn), hasher=hashed)
        field, array = cells_field(column, cells[0][1])
        data = pa.py_buffer(np.ascontiguousarray(digests))
        columns = {
            pa.field("episode", pa.int32()): pa.array(episode),
            pa.field("turn", pa.int32()): pa.array(turn),
            field: array,
            pa.field("odd", pa.string()): pa.nulls(len(turn), pa.string()),
            pa.field(DIGEST, pa.binary(16)): pa.Array.from_buffers(
                pa.binary(16), len(turn), [None, data]
            ),
        }
        return pa.RecordBatch.from_arrays(list(columns.values()), schema=pa.schema(list(columns)))

    # -- columns

    def _block(self, rows: NDArray[Any]) -> tuple[Block, pa.Array | None]:
        masks, texts = self._masks(rows)
        infos = given_values(self._tape, "infos", rows) if self._kernel.info else None
        given = np.ascontiguousarray(rows["given"])
        plain = None
        if self._volatile:
            plain = info_texts(infos, texts, given, without=self._volatile)
        block = Block(
            episode=np.ascontiguousarray(rows["episode"]),
            turn=np.ascontiguousarray(rows["turn"]),
            agent=Coded(np.ascontiguousarray(rows["agent"]), self._names()),
            order=_raw(rows, "order", "has_order"),
            values=self._values(rows),
            mask=masks,
            received=_raw(rows, "received", "given"),
            terminated=_raw(rows, "terminated", "flagged"),
            truncated=_raw(rows, "truncated", "flagged"),
            info=info_texts(infos, texts, given),
            reward=_raw(rows, "reward", "is_paid"),
            terms=self._paid(rows),
            live=np.ascontiguousarray(rows["live"]),
            raised=None,
            odd=None,
        )
        return block, plain

    def _names(self) -> tuple[str, ...]:
        return tuple(seat.name for seat in self._seats)

    def _paid(self, rows: NDArray[Any]) -> dict[str, Raw]:
        found = {}
        valid = np.ascontiguousarray(rows["has_terms"])
        for name in self._terms:
            amounts = np.zeros(len(rows))
            if name in self._kernel.terms:
                amounts += rows["terms"][:, self._kernel.terms.index(name)]  # -0.0 becomes 0.0
            found[name] = Raw(amounts.view(np.uint8).reshape(len(rows), 8), valid)
        return found

    def _values(self, rows: NDArray[Any]) -> dict[str, tuple[Column, Cells]]:
        """Observations and actions by column; a row is null where a column isn't its agent's."""
        values: dict[str, tuple[Column, Cells]] = {}
        for kind, flag in (("obs", "given"), ("action", "acted")):
            for g, group in enumerate(self._kernel.groups):
                seat = self._seats[group.first]
                side = seat.observation if kind == "obs" else seat.action
                assert side is not None  # kernels declare their spaces
                mine = self._of_group(rows, g)
                own = rows if mine is None else rows[mine]
                for column, array in self._leaves(kind, g, side, own):
                    raw = _bytes(column, array)
                    _merge(values, column, raw, np.ascontiguousarray(own[flag]), mine, len(rows))
        return values

    def _leaves(self, kind: str, g: int, side: Side, rows: NDArray[Any]) -> Any:
        """Columns of a group, and their values in its rows."""
        tape = self._tape
        if kind == "action":
            yield side.columns[0], done_values(tape, f"action.{g}", rows)
            return
        space = side.codec.space
        if not isinstance(space, spaces.Dict):
            yield side.columns[0], given_values(tape, f"obs.{g}", rows)
            return
        for key, column in zip(sorted(space.spaces), side.columns, strict=True):
            is_mask = key == MASK and self._kernel.mask is not None
            name = f"mask.{g}" if is_mask else f"obs.{g}.{key}"
            found = given_values(tape, name, rows)
            yield column, found.astype(space.spaces[key].dtype)

    def _of_group(self, rows: NDArray[Any], g: int) -> NDArray[np.intp] | None:
        """Which rows are of a group; None: all."""
        if len(self._kernel.groups) == 1:
            return None
        group = self._kernel.groups[g]
        agent = rows["agent"]
        return np.flatnonzero((agent >= group.first) & (agent < group.first + group.count))

    def _masks(self, rows: NDArray[Any]) -> tuple[dict[int, Raw], pa.Array | None]:
        """The masks of Discrete actions by their length, and what infos tell of all masks."""
        masks: dict[int, Raw] = {}
        if self._kernel.mask is None:
            return masks, None
        texts, places = [], list[Any]()
        for g, group in enumerate(self._kernel.groups):
            mine = self._of_group(rows, g)
            own = rows if mine is None else rows[mine]
            flags = given_values(self._tape, f"mask.{g}", own)
            nvec = getattr(group.action_space, "nvec", None)
            parts = None if nvec is None else tuple(int(n) for n in nvec)
            texts.append(mask_texts(flags, parts))
            places.append(mine)
            if parts is None:
                known = masks.get(flags.shape[1])
                raw = _spread(flags.view(np.uint8), own["given"], mine, len(rows))
                masks[flags.shape[1]] = (
                    raw
                    if known is None
                    else Raw(
                        np.where(raw.valid[:, None], raw.values, known.values),
                        known.valid | raw.valid,
                    )
                )
        if places[0] is None:
            return masks, texts[0]
        back = np.argsort(np.concatenate(places), kind="stable")
        return masks, pa.concat_arrays(texts).take(pa.array(back))


def _raw(rows: NDArray[Any], name: str, flag: str) -> Raw:
    """A column of the rows as bytes; zeros where there is none, as lists of rows have them."""
    valid = np.ascontiguousarray(rows[flag])
    values = np.where(valid, rows[name], np.zeros(1, rows.dtype[name])).astype(rows.dtype[name])
    return Raw(values.view(np.uint8).reshape(len(rows), values.itemsize), valid)


def _bytes(column: Column, values: NDArray[Any]) -> NDArray[np.uint8]:
    """Values as the column keeps them, [rows, bytes]."""
    dtype = "<i8" if column.leaf.kind == "int" else column.leaf.dtype
    whole = np.ascontiguousarray(values, np.dtype(dtype))
    found: NDArray[np.uint8] = whole.view(np.uint8).reshape(len(whole), -1)
    return found


def _spread(values: Any, valid: Any, mine: NDArray[np.intp] | None, count: int) -> Raw:
    """A column of all rows from one of some."""
    if mine is None:
        return Raw(np.ascontiguousarray(values), np.ascontiguousarray(valid))
    whole, there = np.zeros((count, values.shape[1]), np.uint8), np.zeros(count, bool)
    whole[mine], there[mine] = values, valid
    return Raw(whole, there)


def _merge(
    values: dict[str, tuple[Column, Cells]],
    column: Column,
    raw: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    mine: NDArray[np.intp] | None,
    count: int,
) -> None:
    """Puts a group's values into their column, which other groups may share."""
    known = values.get(column.name)
    if known is None or mine is None:
        values[column.name] = column, _spread(raw, valid, mine, count)
        return
    cells: Any = known[1]
    cells.values[mine], cells.valid[mine] = raw, valid


__all__ = ["DIGEST", "TEXT", "KernelPress"]
