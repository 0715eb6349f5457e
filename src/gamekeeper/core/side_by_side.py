"""Two plays of one episode compared stretch by stretch, so that neither has to be whole."""

from __future__ import annotations

from collections.abc import Collection

from gamekeeper.core.divergence import Comparison, Divergence, compare_ends, compare_rows
from gamekeeper.core.extent import Extent, clipped
from gamekeeper.core.strip import Strip
from gamekeeper.core.trace import Trace


class SideBySide:
    """Compares stretches of the same turns as they come; see `divergence.compare`.

    Args:
        known: how far the recorded episode goes.
        tolerance: numbers that differ by no more count as equal; None: bit for bit.
        volatile: info fields that are left out.
    """

    def __init__(
        self, known: Extent, *, tolerance: float | None = None, volatile: Collection[str] = ()
    ) -> None:
        self._known, self._tolerance, self._volatile = known, tolerance, volatile
        self.is_exact = True
        """Whether all that was seen is equal bit for bit."""
        self.largest = 0.0
        """The largest difference of two numbers that was passed over as within tolerance."""
        self.divergence: Divergence | None = None
        """The first place where they differ by more than the tolerance, if there is one."""
        self._last: tuple[Trace, Trace] | None = None

    def look(self, recorded: Trace, replayed: Trace) -> bool:
        """Compares the next turns; whether there is no divergence yet."""
        found = compare_rows(
            recorded, clipped(replayed, self._known),
            tolerance=self._tolerance, volatile=self._volatile,
        )  # fmt: skip
        self.is_exact = self.is_exact and found.is_exact
        self.largest = max(self.largest, found.largest)
        self.divergence, self._last = found.divergence, (recorded, replayed)
        return self.divergence is None

    def ends(self) -> None:
        """Compares what is said of the ends of agents, once all turns were seen."""
        if self.divergence is None and self._last is not None:
            self.divergence = compare_ends(*self._last)
            self.is_exact = self.is_exact and self.divergence is None


def compare_strips(
    recorded: Strip,
    replayed: Strip,
    *,
    known: Extent,
    tolerance: float | None = None,
    volatile: Collection[str] = (),
) -> Comparison:
    """Compares two plays of one episode, a stretch of each in memory.

    Args:
        known: how far the recorded one goes.
        tolerance, volatile: as for `divergence.compare`.
    """
    both = SideBySide(known, tolerance=tolerance, volatile=volatile)
    for trace, before in recorded.stretches():
        until = _end(trace) if before is None else before
        if not both.look(trace, replayed.take(until)):
            break
    else:
        nothing = recorded.take(None)
        for rest, _ in replayed.stretches():  # the first that isn't beyond what is known parts
            if known.turns is not None or not both.look(nothing, rest):
                break
        both.ends()
    return Comparison(both.divergence, is_exact=both.is_exact, largest=both.largest)


def _end(trace: Trace) -> int:
    """The turn after all those that have a row or a state."""
    tables = [table for table in (trace.steps, trace.states) if table is not None]
    return max(
        (int(table["turn"][-1].as_py()) + 1 for table in tables if table.num_rows), default=0
    )
