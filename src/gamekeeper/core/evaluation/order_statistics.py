"""Quantiles with intervals between order statistics, which hold for every distribution."""

from __future__ import annotations

from collections.abc import Sequence

from gamekeeper.core.evaluation.interval import LEVEL, FloatArray, Interval


def fewest_for_quantile(part: float, *, level: float = LEVEL) -> int:
    """How many values the interval of a quantile asks for."""
    raise NotImplementedError


def quantile(
    values: Sequence[float] | FloatArray, part: float, *, level: float = LEVEL
) -> Interval:
    """A quantile with its interval.

    Args:
        values: [n].
        part: in (0, 1); 0.5 is the median.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: fewer than `fewest_for_quantile(part)` values.
    """
    raise NotImplementedError
