"""An estimate with its interval, and what every interval asks of its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import EvidenceError

FloatArray = NDArray[np.float64]
Statistic = Literal["mean", "iqm", "median"]
STATISTICS: Final[tuple[Statistic, ...]] = ("mean", "iqm", "median")
LEVEL: Final = 0.95


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and the interval around it.

    Attributes:
        value: the estimate.
        low: lower bound.
        high: upper bound.
        n: units it rests on: episodes of one checkpoint, or training runs of a method.
        method: how the interval was made, in words.
    """

    value: float
    low: float
    high: float
    n: int
    method: str

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "n": self.n,
            "method": self.method,
        }


def figures(values: Sequence[float] | FloatArray, where: str) -> FloatArray:
    """The values as a flat array of finite numbers.

    Args:
        values: [n].
        where: what asks for them, for the error.
    Raises:
        EvidenceError: they aren't [n], or one isn't finite.
    """
    array = np.asarray(values, np.float64)
    if array.ndim != 1:
        raise EvidenceError(
            "figures have the wrong shape", where=where, expected="[n]", seen=str(array.shape)
        )
    if not np.isfinite(array).all():
        raise EvidenceError(
            "a figure isn't finite",
            where=where,
            expected="finite numbers",
            seen=f"number {int(np.flatnonzero(~np.isfinite(array))[0])} is not",
        )
    return array


def check_level(level: float, where: str, *, most: float = 0.99) -> None:
    """A level is one the intervals were made for.

    Args:
        level: coverage.
        where: what asks, for the error.
        most: the highest there is.
    Raises:
        EvidenceError: it isn't in [0.8, most].
    """
    if not 0.8 <= level <= most:
        raise EvidenceError(
            "no interval of this level",
            where=where,
            expected=f"level in [0.8, {most}]",
            seen=str(level),
        )


def check_statistic(statistic: str, where: str) -> None:
    """A statistic is one there is.

    Raises:
        EvidenceError: it isn't.
    """
    if statistic not in STATISTICS:
        raise EvidenceError(
            "there is no such statistic",
            where=where,
            expected=" or ".join(STATISTICS),
            seen=repr(statistic),
        )
