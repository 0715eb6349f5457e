"""The recorder of a kernel's batch: columns from the first to the last."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.encoder import Encoder
from gamekeeper.episodes.layout import Layout
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.blake2b import row_digests
from gamekeeper.rollouts.interrupts import HeldInterrupt
from gamekeeper.vector.kernel_buffer import KernelBuffer, TickBuffer, TurnBuffer
from gamekeeper.vector.kernel_columns import KernelColumns
from gamekeeper.vector.vector_rows import FLUSH_S, Batches, Recording, never


class KernelRecorder:
    """Steps a batch and hands out its rows as they come.

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
            out: takes streams and batches, each sorted by episode.
            is_next: copies begin their next episode in the step after.
            in_turn_first: of several that end together who would be in turn has its last turn
                first.
        """
        self.is_begun = self._is_compiled = False
        self._out = out
        self._options: str | None = None
        self._buffer: KernelBuffer = (
            TurnBuffer(batch, is_next=is_next, in_turn_first=in_turn_first)
            if batch.kernel.api == "aec"
            else TickBuffer(batch, is_next=is_next)
        )
        terms, volatile = recording.terms, recording.volatile
        self._columns = KernelColumns(self._buffer, layout, terms=terms, volatile=volatile)
        self._encoder = Encoder(layout, never, level=recording.level, hasher=row_digests)
        self._flushed_s = time.monotonic()

    def begin(self, options: Any) -> None:
        """The run has begun; `options` is what its resets were told."""
        self.is_begun = True
        self._options = None if options is None else to_json(options)
        self._buffer.begin()

    def step(self) -> None:
        """One step of every copy.

        Raises:
            ActionError: an action isn't legal; nothing has changed.
        """
        with HeldInterrupt() if self._is_compiled else nullcontext():  # who compiles can be stopped
            self._step()
        self._is_compiled = True

    def _step(self) -> None:
        """Moves rows that left the buffer to the writer."""
        buffer = self._buffer
        buffer.step()
        if buffer.filled == buffer.slots or time.monotonic() - self._flushed_s > FLUSH_S:
            self._flush(is_last=False)

    def end(self) -> None:
        """The episodes in progress end as *cut*; the rest goes out."""
        if self.is_begun:
            with HeldInterrupt():
                self._flush(is_last=True)

    def _flush(self, *, is_last: bool) -> None:
        columns = self._columns.taken(options=self._options, is_last=is_last)
        self._buffer.carry()
        self._flushed_s = time.monotonic()
        self._out(list(self._encoder.encode_columns(columns).in_order()))
