"""When a series counts as growing: what checks of cost share."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

WINDOWS: Final = 8
"""Into so many stretches of equal length a play is cut; one alone says little."""
LEAST_TURNS: Final = 40
COUNTS: Final = """\
def work(function, *arguments):
    lines = 0
    def tracer(frame, event, argument):
        nonlocal lines
        lines += event == 'line'
        return tracer
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    sys.settrace(tracer)
    try:
        function(*arguments)
    finally:
        sys.settrace(None)
    peak = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    return np.array([lines, peak])
"""
"""Lines of a proof: `work` says how many lines of Python a call runs, and what memory it takes."""


def means(values: Sequence[float], windows: int = WINDOWS) -> list[float]:
    """The mean of each of `windows` equal stretches; what is left over at the end is left out."""
    width = len(values) // windows
    return [sum(values[k * width : (k + 1) * width]) / width for k in range(windows)]


def is_rising(stretches: Sequence[float], *, factor: float, least: float) -> bool:
    """Whether each stretch is above the one before, and the last far above the first.

    Args:
        stretches: in their order; one of them may be out of order.
        factor: the last is so many times the first at least.
        least: and above it by so much at least.
    """
    first, last = stretches[0], stretches[-1]
    falls = sum(b <= a for a, b in pairwise(stretches))
    return falls <= len(stretches) // 8 and last >= factor * first and last - first >= least
