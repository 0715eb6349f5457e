"""Intervals that hold at every n at once, so that one may stop when they are narrow enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gamekeeper.core.evaluation.interval import LEVEL, FloatArray, Interval


@dataclass(frozen=True, slots=True)
class ConfidenceSequence:
    """An interval of a mean for every number of values, all holding at once with chance `level`.

    Attributes:
        least: the least a value can be (0 for success); None: values aren't bounded.
        most: the most a value can be (1 for success); None with `least`.
        level: chance that all intervals hold.
    """

    least: float | None = None
    most: float | None = None
    level: float = LEVEL

    @property
    def warm_up(self) -> int:
        """Values before which nothing is claimed: the interval is everything there is."""
        raise NotImplementedError

    def sequence(self, values: Sequence[float] | FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds after each value.

        Args:
            values: [n] in the order in which they were played.
        Returns:
            [n] lower and [n] upper bounds of the mean.
        Raises:
            EvidenceError: a value isn't finite, or outside of the bounds.
        """
        raise NotImplementedError

    def stop_at(self, values: Sequence[float] | FloatArray, width: float) -> int | None:
        """How many values suffice for an interval at most so wide; None: not these.

        Args:
            values: [n] in the order in which they were played.
            width: high - low, in the values' units, over 0.
        """
        raise NotImplementedError

    def interval(self, values: Sequence[float] | FloatArray) -> Interval:
        """The mean of all values with the interval after the last, valid however one stopped.

        Args:
            values: [n] in the order in which they were played.
        """
        raise NotImplementedError
