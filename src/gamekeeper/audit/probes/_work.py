"""Work without a clock: lines of Python run, and memory taken, which are the same on every run."""

from __future__ import annotations

import gc
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, TypeVar

T = TypeVar("T")

PAD: Final = "*_arraypad_impl.py"


@dataclass(frozen=True, slots=True)
class Work:
    """What one piece of work took.

    Attributes:
        lines: of Python, as a debugger steps through them.
        passing_bytes: memory that was taken at the peak, beyond what was there before.
    """

    lines: int
    passing_bytes: int


@contextmanager
def traced_memory() -> Iterator[None]:
    """Memory is traced in here; where somebody traces it already, they go on doing so."""
    is_traced = tracemalloc.is_tracing()
    gc.collect()
    gc.freeze()  # what is there already needn't be gone through at every collection
    if not is_traced:
        tracemalloc.start()
    try:
        yield
    finally:
        if not is_traced:
            tracemalloc.stop()
        gc.unfreeze()


def work_of(function: Callable[[], T]) -> tuple[T, Work]:
    """What a call returns, and what it took; within `traced_memory`."""
    counted = 0

    def count(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal counted
        counted += event == "line"
        return count

    before, debugger = tracemalloc.get_traced_memory()[0], sys.gettrace()
    tracemalloc.reset_peak()
    sys.settrace(count)
    try:
        value = function()
    finally:
        sys.settrace(debugger)
    return value, Work(counted, tracemalloc.get_traced_memory()[1] - before)


def kept_bytes() -> int:
    """Bytes in use of what was taken since tracing began, but for two takers that nobody can mend.

    NumPy 2.4's `pad` keeps some 50 bytes at every call, and tracing has books of its own.
    """
    others = [tracemalloc.Filter(False, name) for name in (PAD, tracemalloc.__file__)]
    return sum(each.size for each in tracemalloc.take_snapshot().filter_traces(others).traces)
