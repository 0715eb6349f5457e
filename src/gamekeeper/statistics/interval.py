"""An estimate with its interval, and what every interval asks of its figures."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import ceil, floor, log10
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import EvidenceError, check_choice

FloatArray = NDArray[np.float64]
Statistic = Literal["mean", "iqm", "median"]
STATISTICS: Final[tuple[Statistic, ...]] = ("mean", "iqm", "median")
LEVEL: Final = 0.95
_MOST_DECIMALS: Final = 5
_LARGEST: Final = 1e7
"""Figures with more decimals, or as large, are written with an exponent."""


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and the interval around it.

    Attributes:
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
        return asdict(self)


def rounded(value: float, low: float, high: float, *, sign: str = "") -> str:
    """A figure with as many digits as its interval supports: two or one of its half-width.

    Args:
        value: the estimate, or one of its bounds.
        high: upper bound; equal to the lower one it says nothing, and four digits are given.
        sign: "+" to have it before positive figures, too.
    """
    half = (high - low) / 2
    if not 0.0 < half < float("inf"):
        return f"{value:{sign}z.4g}"
    decimals = ceil(-log10(half / 3))
    largest = max(abs(low), abs(high))
    if decimals > _MOST_DECIMALS or largest >= _LARGEST:
        digits = max(floor(log10(largest)) + 1 + decimals, 1)
        return f"{value:{sign}z.{digits}g}"
    return f"{round(value, decimals):{sign}z.{max(decimals, 0)}f}"


def figures(values: Sequence[float] | FloatArray, where: str) -> FloatArray:
    """The values [n] as a flat array of finite numbers.

    Raises:
        EvidenceError: they aren't [n], or one isn't finite.
    """
    array = np.asarray(values, np.float64)
    if array.ndim != 1:
        raise EvidenceError(
            "figures have the wrong shape",
            where=where,
            expected="[n]",
            actual=str(array.shape),
            fix="hand in one dimension of figures",
        )
    if not np.isfinite(array).all():
        raise EvidenceError(
            "a figure isn't finite",
            where=where,
            expected="finite numbers",
            actual=f"number {int(np.flatnonzero(~np.isfinite(array))[0])} is not",
            fix="leave out episodes without a finite figure, and say so",
        )
    return array


def check_level(level: float, where: str, *, most: float = 0.99) -> None:
    """A level is one the intervals were made for.

    Raises:
        EvidenceError: it isn't in [0.8, most].
    """
    if not 0.8 <= level <= most:
        raise EvidenceError(
            "there is no interval of this level",
            where=where,
            expected=f"level in [0.8, {most}]",
            actual=str(level),
            fix="choose a level of this range; 0.95 is usual",
        )


def check_statistic(statistic: str, where: str) -> None:
    """A statistic is one there is.

    Raises:
        EvidenceError: it isn't.
    """
    what = "there is no such statistic"
    check_choice(statistic, STATISTICS, what, where=where, error=EvidenceError)


FEWEST_EPISODES: Final[dict[Statistic, int]] = {"mean": 95, "iqm": 20, "median": 10}
"""Episodes of one checkpoint from which on an interval covers at its level (docs/statistics.md).
The mean asks for most, 100 of which a twentieth may break off: of 50 episodes none is a crash that
comes once in 50, in 36 % of all samples, and no interval can know of it."""
FEWEST_OF_TWO: Final = 50
"""Episodes, or pairs of them, for the mean of two outcomes, of which a third can't be rare."""
FEWEST_RUNS: Final[dict[Statistic, int]] = {"mean": 30, "iqm": 12, "median": 10}
"""Training runs of a method from which on an interval covers at its level: of 20 none is among the
one in ten that fail in 12 % of all samples, of 30 in 4 %."""
FEWEST_RUNS_SHARE: Final = 20
"""Training runs for the mean of shares of success, which can't be far off."""
FEWEST_RUNS_APART: Final = 10
"""Training runs of each of two methods for their difference, and which of them is better."""
FEWEST_RUNS_TOGETHER: Final = 30
"""Training runs in all environments together, where there are several."""
FEWEST_RUNS_EACH: Final = 3
"""Training runs in each of several environments."""
FEWEST_RUNS_FOR_MEDIANS: Final = 30
"""Training runs in each environment for the median over environments of their means."""
MANY_PAIRS: Final = 50
"""Pairs of episodes from which on Tango's interval of who beats whom covers; of fewer an exact one
is given."""

RULE_OF_THREE: Final = 3
"""An outcome of a chance over 3 / n is seen in 95 of 100 samples of n."""
AGENTS_OF_ONE_EPISODE: Final = (
    "agents of one episode are no sample: they share its seed, its partners and its luck, so an "
    "interval over them claims more evidence than there is; the unit is the episode (for one "
    "checkpoint) or the training run (for a method)"
)


def enough(n: int, fewest: int, unit: str, *, where: str) -> None:
    """There are as many units as the interval asks for.

    Args:
        unit: "episodes", "pairs" or "training runs".
    Raises:
        EvidenceError: there are fewer.
    """
    if n >= fewest:
        return
    raise EvidenceError(
        f"too few {unit} for an interval of this level",
        where=where,
        expected=f"at least {fewest} {unit}",
        actual=str(n),
        fix=f"add {unit}, or show the figures without an interval",
    )


def no_spread(value: float, n: int, unit: str, *, where: str) -> EvidenceError:
    """The refusal of an interval around n figures ("episodes", "pairs") that are all one number.

    They say nothing of their spread. What n of them may have missed is said by the rule of three:
    an outcome of a chance over 3 / n would have been seen in 95 of 100 such samples.

    Source: Hanley & Lippman-Hand 1983, "If nothing goes wrong, is everything all right?"
    """
    rare = n // RULE_OF_THREE
    missed = f"; values rarer than 1 in {rare} may be missing"
    return EvidenceError(
        f"all {n} {unit} have the same value, so nothing is known of its spread"
        f"{missed if rare > 1 else ''}",
        where=where,
        expected="values that differ",
        actual=f"{value:g}",
        fix=f"show the figure without an interval, or add {unit}",
    )
