"""The probability that one beats the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gamekeeper.core.evaluation.interval import LEVEL, FloatArray, Interval

Figures = Sequence[float] | FloatArray


def probability_of_improvement(a: Figures, b: Figures) -> float:
    """The chance that a value of `a` is above one of `b`, ties counting half (Mann-Whitney).

    Args:
        a: [n].
        b: [m].
    Raises:
        EvidenceError: one has no values, or a value isn't finite.
    """
    raise NotImplementedError


def improvement(
    a: Figures | Mapping[str, Figures],
    b: Figures | Mapping[str, Figures],
    *,
    paired: bool,
    level: float = LEVEL,
) -> Interval:
    """The probability that `a` beats `b`, ties counting half, with an interval.

    Args:
        a: [n] scores of runs (not paired), or figures of episodes on shared seeds (paired); or such
            by environment, and then the mean over environments, as in rliable.
        b: of the other; equally many where paired.
        paired: value k of `a` meets value k of `b` alone.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: too few, different environments, or pairs that don't match.
    """
    raise NotImplementedError
