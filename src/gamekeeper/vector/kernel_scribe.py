"""The scribe: records a batch, columns from the first to the last."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, Final

import numpy as np
import pyarrow as pa
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.core.block import most_rows
from gamekeeper.core.canon import to_json
from gamekeeper.core.layout import Layout
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.parts import HORIZON, UNNAMED
from gamekeeper.run.held_back import HeldBack
from gamekeeper.vector.kernel_order import Ordered
from gamekeeper.vector.kernel_press import KernelPress
from gamekeeper.vector.kernel_tape import TERMINATED, TRUNCATED, Tape
from gamekeeper.vector.kernel_ticks import TickTape
from gamekeeper.vector.kernel_turns import TurnTape
from gamekeeper.vector.rows import FLUSH_S, Batches, Recording

NAMES: Final = {
    HORIZON: "horizon", UNNAMED + TERMINATED: "terminated", UNNAMED + TRUNCATED: "truncated",
}  # fmt: skip


class Scribe:
    """Steps a batch and hands out its rows, episode by episode.

    Attributes:
        is_begun: whether the run has begun.
    """

    def __init__(
        self,
        batch: Batch,
        recording: Recording,
        out: Callable[[Batches], None],
        *,
        layout: Layout,
        is_next: bool,
        in_turn_first: bool,
    ) -> None:
        """Takes a batch that hasn't begun.

        Args:
            batch: whose copies.
            recording: level, terms, volatile infos.
            out: takes streams and batches in the order in which they are written.
            layout: the columns of the environment.
            is_next: copies begin their next episode in the step after.
            in_turn_first: of several that end together who would be in turn has its last turn
                first.
        """
        self.is_begun = self._is_compiled = False
        self._kernel, self._level, self._out = batch.kernel, recording.level, out
        self._tape: Tape = (
            TurnTape(batch, is_next=is_next, in_turn_first=in_turn_first)
            if batch.kernel.api == "aec"
            else TickTape(batch, is_next=is_next)
        )
        self._press = KernelPress(
            self._tape, layout, terms=recording.terms, volatile=recording.volatile
        )
        self._most = most_rows([*layout.columns("obs"), *layout.columns("action")])
        self._order = Ordered(level=self._level, options=None, most_rows=self._most)
        self._flushed_s = time.monotonic()

    def begin(self, options: Any) -> None:
        """The run has begun; `options` is what its resets were told."""
        self.is_begun = True
        text = None if options is None else to_json(options)
        self._order = Ordered(level=self._level, options=text, most_rows=self._most)
        self._tape.begin()

    def step(self) -> None:
        """One step of every copy.

        Raises:
            ActionError: an action isn't legal; nothing has changed.
        """
        with HeldBack() if self._is_compiled else nullcontext():  # who compiles can be stopped
            self._step()
        self._is_compiled = True

    def _step(self) -> None:
        """What is played is on the tape, and what left the tape gets to where it is written."""
        tape = self._tape
        tape.step()
        if tape.filled == tape.slots or time.monotonic() - self._flushed_s > FLUSH_S:
            self._flush(is_last=False)
            self._out(self._order.ready())

    def end(self) -> None:
        """The episodes in progress end as *cut*; the rest goes out."""
        if self.is_begun:
            with HeldBack():
                self._flush(is_last=True)
                self._out(self._order.rest())

    def _flush(self, *, is_last: bool) -> None:
        tape, order = self._tape, self._order
        order.add("starts", _batch(tape.apart.starts))
        order.add("steps", self._press.steps(is_last=is_last, level=self._level))
        order.add("states", self._press.states(is_last=is_last))
        order.add("ends", self._ends({k: list(v) for k, v in tape.apart.ends.items()}, "ended"))
        if is_last:
            e = np.flatnonzero(tape.given["open"][tape.filled])
            now = {name: tape.given[name][tape.filled, e] for name in ("episode", "clock")}
            cut = {"episode": now["episode"], "turns": now["clock"], **tape.end_of(e)}
            order.add("ends", self._ends({name: [part] for name, part in cut.items()}, "cut"))
        tape.carry()
        self._flushed_s = time.monotonic()

    def _ends(self, parts: dict[str, list[NDArray[Any]]], end: str) -> pa.RecordBatch | None:
        if not parts:
            return None
        columns = {name: np.concatenate(part) for name, part in parts.items()}
        order = np.argsort(columns["episode"])
        columns = {name: column[order] for name, column in columns.items()}
        return pa.RecordBatch.from_pydict(
            {
                "episode": pa.array(columns["episode"], pa.int32()),
                "turns": pa.array(columns["turns"], pa.int32()),
                "end": _repeated(end, len(order)),
                "endings": _by_pattern(columns["endings"], self._endings),
                "action_types": _by_pattern(columns["has_acted"], self._types),
            }
        )

    def _endings(self, codes: list[int]) -> str | None:
        """Why each agent ended, as JSON; None where none did."""
        kernel = self._kernel
        reasons = {
            agent: NAMES[code] if code in NAMES else kernel.endings[code - 1]
            for agent, code in zip(kernel.agents, codes, strict=True)
            if code
        }
        return to_json(reasons) if reasons else None

    def _types(self, has_acted: list[bool]) -> str:
        """Of what type the whole numbers were that agents acted with, as JSON."""
        kernel: Kernel = self._kernel
        named = {
            agent: "int"
            for agent, acted in zip(kernel.agents, has_acted, strict=True)
            if acted and isinstance(kernel.action_of(agent), spaces.Discrete)
        }
        return to_json(named)


def _batch(parts: dict[str, list[NDArray[Any]]]) -> pa.RecordBatch | None:
    if not parts:
        return None
    columns = {name: np.concatenate(part) for name, part in parts.items()}
    order = np.argsort(columns["episode"])
    return pa.RecordBatch.from_pydict(
        {name: pa.array(column[order]) for name, column in columns.items()}
    )


def _repeated(text: str, count: int) -> pa.Array:
    return pa.array([text], pa.string()).take(pa.array(np.zeros(count, np.int32)))


def _by_pattern(rows: NDArray[Any], text_of: Callable[[list[Any]], str | None]) -> pa.Array:
    """A text for each row; equal rows have one text."""
    patterns, codes = np.unique(rows, axis=0, return_inverse=True)
    texts = [text_of(pattern) for pattern in patterns.tolist()]
    return pa.array(texts, pa.string()).take(pa.array(codes.reshape(-1)))
