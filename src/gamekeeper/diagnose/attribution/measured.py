"""A mean over episodes, with an interval where there are enough of them to claim one. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.core.paired import FEWEST, paired_effect


@dataclass(frozen=True, slots=True)
class Measured:
    """A mean over episodes, in units of return.

    Attributes:
        value: the mean.
        low: lower bound of its 95 % interval; None where fewer than 50 episodes were played.
        high: upper bound.
        p: of it being 0.
        n: episodes.
        baseline: what it is measured against.
    """

    value: float
    low: float | None
    high: float | None
    p: float | None
    n: int
    baseline: str

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "value": self.value, "low": self.low, "high": self.high, "p": self.p, "n": self.n,
            "baseline": self.baseline,
        }  # fmt: skip


def measured(
    values: NDArray[np.float64], *, baseline: str, rng: Generator, unit: float = 1.0
) -> Measured | None:
    """The mean of figures of episodes; None where there is no episode.

    Args:
        values: [episodes].
        baseline: what they are measured against.
        rng: draws resamples.
        unit: what one of them could be where all are 0: that none was seen doesn't show that there
            is none, so the interval holds as many as n episodes may well have hidden.
    """
    if not len(values):
        return None
    if len(values) < FEWEST:
        return Measured(float(np.mean(values)), None, None, None, len(values), baseline)
    effect = paired_effect(np.zeros(len(values)), np.asarray(values, np.float64), rng=rng)
    scale = unit if not values.any() else 1.0
    low, high = effect.low * scale, effect.high * scale
    return Measured(effect.value, low, high, effect.p, effect.n, baseline)
