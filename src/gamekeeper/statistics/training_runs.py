"""Claims about a method: statistics over its training runs, with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.interval import (
    FEWEST_RUNS,
    FEWEST_RUNS_APART,
    FEWEST_RUNS_SHARE,
    LEVEL,
    FloatArray,
    Interval,
    Statistic,
    check_level,
    check_statistic,
    enough,
    figures,
    no_spread,
)
from gamekeeper.statistics.one_sample import around
from gamekeeper.statistics.paired import PairedEffect, least_p
from gamekeeper.statistics.resampling import stratified, weighted_means
from gamekeeper.statistics.student import hypotenuse, student, student_p

Scores = FloatArray | Sequence[float] | Sequence[FloatArray] | Sequence[Sequence[float]]
"""[runs] a score of each, [runs, episodes], or a list of runs of different lengths (ragged)."""


def run_scores(scores: Scores, *, where: str = "run_scores") -> FloatArray:
    """The score of each run, [runs], [runs, episodes] or ragged: the mean over its episodes.

    Raises:
        EvidenceError: there is no run, a run without episodes, or a figure that isn't finite.
    """
    enough(len(scores), 1, "training runs", where=where)
    if np.ndim(scores[0]) == 0:
        return figures(scores, where)  # type: ignore[arg-type]  # [runs]: the first is a number
    rows = [figures(row, where) for row in scores]  # type: ignore[arg-type]  # rows of numbers
    for row in rows:
        enough(len(row), 1, "episodes of a run", where=where)
    return np.array([row.mean() for row in rows])


def crossed(scores: Scores, *, where: str) -> FloatArray | None:
    """The scores as [runs, episodes] where all runs played equally many; None for [runs].

    Args:
        scores: [runs] or [runs, episodes].
    Raises:
        EvidenceError: runs played different numbers of episodes.
    """
    if np.ndim(scores[0]) == 0:
        return None
    lengths = sorted({len(row) for row in scores})  # type: ignore[arg-type]  # rows of numbers
    if len(lengths) > 1:
        raise EvidenceError(
            "runs didn't play the same seeds",
            where=where,
            expected="equally many episodes of each run, column for column on one seed",
            actual=f"{lengths[0]} to {lengths[-1]} episodes",
            fix="play the same seeds, or say shared_seeds=False",
        )
    return np.asarray(scores, np.float64)


FEWEST_SEEDS: Final = 10
"""Shared episode seeds from which on their luck can be told."""


@dataclass(frozen=True, slots=True)
class Crossed:
    """Runs that all played the same episode seeds.

    Attributes:
        values_re: [runs, episodes].
        kept: [kept runs] those that the statistic rests on.
        weight: of their mean in the estimate.
    """

    values_re: FloatArray
    kept: NDArray[np.intp]
    weight: float


def variance_of_seeds(blocks: Sequence[Crossed], *, where: str) -> float:
    """Variance of the estimate because of the seeds that were drawn.

    Scores are run + seed + what is left; the variance of the mean over columns, less what the
    residue puts there (which the interval over runs already holds), is the seeds'.

    Args:
        blocks: of one environment, so that all have the same columns.
    Raises:
        EvidenceError: fewer seeds than `FEWEST_SEEDS`.
    Source: Searle, Casella & McCulloch 1992, ch. 4 (the two-way crossed model); Owen 2007, "The
        pigeonhole bootstrap", for resampling runs alone being too short here.
    """
    episodes = blocks[0].values_re.shape[1]
    enough(episodes, FEWEST_SEEDS, "shared episode seeds", where=where)
    together: FloatArray = np.zeros(episodes)
    residue = 0.0
    for block in blocks:
        rows = block.values_re[block.kept]
        together += block.weight * rows.mean(axis=0)
        # A column's mean holds the residue of the runs in it, too, which is no luck of its seed.
        residue += block.weight**2 * _residue(block.values_re) / (len(rows) * episodes)
    variance = float(together.var(ddof=1)) / episodes
    return float(max(variance - residue, 0.0))


def reach_of_seeds(blocks: Sequence[Crossed], *, where: str) -> Callable[[float], float]:
    """Error of one environment's estimate because of the seeds that were drawn, by level.

    Raises:
        EvidenceError: fewer seeds than `FEWEST_SEEDS`.
    Source: `variance_of_seeds`.
    """
    error = sqrt(variance_of_seeds(blocks, where=where))
    freedom = blocks[0].values_re.shape[1] - 1
    return lambda level: student(level, freedom) * error


def too_long(runs: float, seeds: float, freedoms: tuple[float, float], level: float) -> float:
    """Part of the hypotenuse of two Student's reaches that is one's of both sources together.

    Each reaches as far as its own few degrees of freedom ask; together they have more.

    Args:
        runs: how far the estimate may be off because of the runs.
    Returns:
        At most 1.
    Source: Satterthwaite 1946, "An approximate distribution of estimates of variance components".
    """
    far = [student(level, freedom) for freedom in freedoms]
    # A reach is Student's times the error: divided by it, the square is the variance.
    squares = [float((reach / each) ** 2) for reach, each in zip((runs, seeds), far, strict=True)]
    whole = hypotenuse(runs, seeds)
    if min(squares) <= 0.0:
        return 1.0
    parts = (square**2 / freedom for square, freedom in zip(squares, freedoms, strict=True))
    freedom = sum(squares) ** 2 / sum(parts)
    return min(student(level, freedom) * sqrt(sum(squares)) / whole, 1.0)


def _residue(values_re: FloatArray) -> float:
    """The mean square of what neither run nor seed explains."""
    runs, episodes = values_re.shape
    if runs < 2:
        return 0.0
    left = values_re - values_re.mean(axis=0) - values_re.mean(axis=1)[:, None] + values_re.mean()
    return float((left**2).sum() / ((runs - 1) * (episodes - 1)))


def over_runs(
    scores: Scores,
    *,
    statistic: Statistic = "mean",
    shared_seeds: bool = True,
    rng: Generator,
    level: float = LEVEL,
    is_share: bool = False,
) -> Interval:
    """A statistic over the scores of a method's training runs, with an interval.

    Only runs are resampled, never the episodes within them: the spread of run scores already holds
    the luck of their episodes, and resampling these too counts it twice. What all runs have in
    common, the episode seeds, is no run's luck; it is added from the columns.

    Args:
        scores: [runs, episodes], [runs] (means over many episodes), or ragged.
        statistic: of the runs' scores, each the mean over its episodes.
        shared_seeds: column k is the same episode seed in all runs, as `gamekeeper evaluate` plays
            them; the luck of the seeds is then part of the interval. Ragged scores need False, and
            the claim is then about the seeds that were played.
        level: coverage, in [0.8, 0.99].
        is_share: scores are shares of success.
    Raises:
        EvidenceError: fewer runs than `FEWEST_RUNS[statistic]` (shares: `FEWEST_RUNS_SHARE`), fewer
            shared seeds than `FEWEST_SEEDS`, a figure isn't finite, or all runs have one score.
    Source: Davison & Hinkley 1997, 3.8 (resampling of clusters); `around` for the interval over
        runs; `with_seeds`.
    """
    run_means = run_scores(scores, where="over_runs")
    check_statistic(statistic, "over_runs")
    check_level(level, "over_runs")
    fewest = FEWEST_RUNS_SHARE if is_share and statistic == "mean" else FEWEST_RUNS[statistic]
    enough(len(run_means), fewest, "training runs", where="over_runs")
    matrix = crossed(scores, where="over_runs") if shared_seeds else None
    blocks = [] if matrix is None else [Crossed(matrix, kept_runs(run_means, statistic), 1.0)]
    luck = reach_of_seeds(blocks, where="over_runs") if blocks else None
    found = around(
        run_means,
        statistic=statistic,
        rng=rng,
        level=level,
        is_share=is_share,
        unit="training runs",
    )
    if matrix is None or luck is None:
        return found
    return with_seeds(found, luck(level), (len(run_means) - 1, matrix.shape[1] - 1), level)


def with_seeds(
    found: Interval, seeds: float, freedoms: tuple[float, float], level: float
) -> Interval:
    """An interval over runs that holds the luck of the seeds they share, too.

    Args:
        found: over runs alone.
        seeds: how far the estimate may be off because of the seeds.
    Source: Zou & Donner 2008 for putting the distances of two sources together, `too_long` for
        what this is too far.
    """
    part = too_long((found.high - found.low) / 2, seeds, freedoms, level)
    low = found.value - part * hypotenuse(found.value - found.low, seeds)
    high = found.value + part * hypotenuse(found.high - found.value, seeds)
    return Interval(found.value, low, high, found.n, f"{found.method}, and of shared seeds")


ALIKE: Final = 0.25
"""Runs are alike where half of them are within so much of the spread from the median of theirs:
0.67 of normal scores, about 0.5 of exponential ones."""
LEAST_CARRYING: Final = 4.0
"""Runs that carry the spread of two methods of runs that are alike, for an interval."""
FEWEST_TO_TELL: Final = 20
"""Runs of each from which on that is told; of fewer, ordinary ones look like it by chance, and to
refuse these leaves intervals that cover too little."""


def carrying(one: FloatArray, two: FloatArray) -> FloatArray:
    """Number of runs that carry the spread within two methods; all of them where it is even.

    Args:
        one: [..., runs] scores of the one method, two: of the other.
    Returns:
        [...] the squared sum of squared deviations over the sum of their squares; 0 without any.
    Source: Hannah & Kay 1977, "Concentration in modern industry" (numbers equivalent).
    """
    squares = _off(np.mean, one, two) ** 2
    whole = (squares**2).sum(axis=-1)
    return np.asarray(squares.sum(axis=-1) ** 2 / np.where(whole > 0, whole, 1.0))


def rests_on_few(one: FloatArray, two: FloatArray) -> NDArray[np.bool_]:
    """Tells if `FEWEST_TO_TELL` runs of two methods that overlap are alike, but for a few.

    Their difference hangs on how many such runs were among those that were trained, and its
    interval would cover up to 99 %.

    Args:
        one: [..., runs] scores of the one method, two: of the other.
    """
    if min(one.shape[-1], two.shape[-1]) < FEWEST_TO_TELL:
        return np.zeros(one.shape[:-1], bool)
    spread = np.sqrt((_off(np.mean, one, two) ** 2).mean(axis=-1))
    is_alike = np.median(np.abs(_off(np.median, one, two)), axis=-1) < ALIKE * spread
    is_apart = (one.max(axis=-1) < two.min(axis=-1)) | (two.max(axis=-1) < one.min(axis=-1))
    return np.asarray(is_alike & (carrying(one, two) < LEAST_CARRYING) & ~is_apart)


def _off(middle: Callable[..., Any], one: FloatArray, two: FloatArray) -> FloatArray:
    """[..., runs of both] deviations from the middle of its own method."""
    return np.concatenate([x - middle(x, axis=-1, keepdims=True) for x in (one, two)], axis=-1)


def difference_over_runs(
    a: Scores, b: Scores, *, shared_seeds: bool = True, rng: Generator, level: float = LEVEL
) -> PairedEffect:
    """The mean of `b - a` over training runs of two methods, with an interval and a p-value.

    The bootstrap-t of the two samples' difference in mean, runs being resampled within each.

    Args:
        a: [runs, episodes], [runs] or ragged, of one method.
        b: of the other; it may have another number of runs.
        shared_seeds: column k is the same episode seed in all runs of both.
        level: coverage, in [0.8, 0.99].
    Returns:
        value, low, high and p; `n` is the smaller number of runs. `b - a`, as `paired_effect`. The
        p-value is the least for which the interval leaves 0 out.
    Raises:
        EvidenceError: fewer runs than `FEWEST_RUNS_APART` of either, seeds that aren't shared,
            a figure isn't finite, all runs of each method have the same score, or
            `rests_on_few`.
    Source: `stratified` and `reach_of_seeds`, put together as in `over_runs`.
    """
    where = "difference_over_runs"
    check_level(level, where)
    strata = [run_scores(each, where=where) for each in (a, b)]
    runs = min(map(len, strata))
    enough(runs, FEWEST_RUNS_APART, "training runs of each method", where=where)
    if rests_on_few(*strata):
        raise EvidenceError(
            "training runs are alike but for a few that carry all of the spread, so that the "
            "difference hangs on these alone",
            where=where,
            expected=f"a spread carried by {LEAST_CARRYING:g} runs, or methods that don't overlap",
            actual=f"by {float(carrying(*strata)):.1f}",
            fix="add training runs, or compare interquartile means",
        )
    found = stratified(strata, weighted_means([-1.0, 1.0]), rng)
    seeds = _seeds_of_both(a, b) if shared_seeds else _no_seeds

    def off(level: float) -> tuple[float, float]:
        """Error of the estimate above the truth, at least and at most."""
        least, most = found.bounds(level) if found.bounds else (0.0, 0.0)
        luck = seeds(level)
        return -hypotenuse(least * found.error, luck), hypotenuse(most * found.error, luck)

    least, most = off(level)
    value = found.value
    if most == least:
        raise no_spread(value, runs, "training runs", where=where)
    p = least_p(off, value, found.freedom or runs - 1)
    return PairedEffect(value, value - most, value - least, p, runs)


@dataclass(frozen=True, slots=True)
class MeetingLuck:
    """Luck of single meetings, which the means of both runs hold that meet.

    Attributes:
        variance: of the mean over all meetings because of it.
        freedom: degrees that it was estimated with.
    """

    variance: float
    freedom: int


FEWEST_FREE: Final = 10
"""Degrees of freedom from which on the luck of single meetings can be told."""


def luck_of_meetings(pairs: Sequence[tuple[int, int]], means: FloatArray) -> MeetingLuck | None:
    """The residue of the means of meetings about what their two runs add; None of too few.

    Args:
        pairs: of each meeting, the run in one position and the run in the other.
        means: [meetings] over its episodes.
    Source: Searle, Casella & McCulloch 1992, ch. 4 (the two-way crossed model).
    """
    positions = [sorted({pair[position] for pair in pairs}) for position in (0, 1)]
    columns = [
        [pair[position] == run for pair in pairs]
        for position in (0, 1)
        for run in positions[position]
    ]
    design = np.array(columns, np.float64).T
    freedom = len(pairs) - int(np.linalg.matrix_rank(design))
    if freedom < FEWEST_FREE:
        return None
    fitted = design @ np.linalg.lstsq(design, means, rcond=None)[0]
    residue = float(((means - fitted) ** 2).sum()) / freedom
    return MeetingLuck(residue / len(pairs), freedom)


def over_meetings(
    blocks: Sequence[FloatArray],
    *,
    times: float = 1.0,
    luck: MeetingLuck | None = None,
    level: float = LEVEL,
) -> PairedEffect:
    """The mean over meetings of runs on shared seeds, with an interval and the p-value of 0.

    Meetings share runs and seeds, so that they aren't a sample. The mean's variance is that of a
    U-statistic: of each method, the variance of its runs' means over their meetings; and the
    seeds', which is that of the mean over all meetings from seed to seed, less what runs hold of
    it already.

    Args:
        blocks: by method [runs, episodes], of each run the mean over its meetings.
        times: what a run's mean is enlarged by: in how many positions its method sits.
        luck: of single meetings, where runs vary in both positions: it is in the means of both, and
            counts once.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: fewer runs than `FEWEST_RUNS_APART` of a method, or fewer seeds than
            `FEWEST_SEEDS`.
    Source: van der Vaart 1998, "Asymptotic statistics", ch. 12 (Hajek projection of one- and
        two-sample U-statistics); Searle, Casella & McCulloch 1992, ch. 4, for the seeds;
        Satterthwaite 1946 for the degrees of freedom.
    """
    where = "over_meetings"
    check_level(level, where)
    for block in blocks:
        enough(len(block), FEWEST_RUNS_APART, "training runs of each method", where=where)
    episodes = blocks[0].shape[1]
    enough(episodes, FEWEST_SEEDS, "shared episode seeds", where=where)
    by_seed = np.mean([block.mean(axis=0) for block in blocks], axis=0)
    parts, within = [], 0.0
    for block in blocks:
        parts.append((times**2 * float(block.mean(axis=1).var(ddof=1)) / len(block), len(block)))
        within += times**2 * _residue(block) / (len(block) * episodes)
    if luck is not None and sum(part for part, _ in parts) < 2 * luck.variance:
        parts, luck = [(luck.variance, luck.freedom + 1)], None  # runs don't differ but by it
    parts.append((max(float(by_seed.var(ddof=1)) / episodes - within, 0.0), episodes))
    variance = sum(part for part, _ in parts) - (0.0 if luck is None else luck.variance)
    value = float(by_seed.mean())
    n = min(map(len, blocks))
    if variance <= 1e-24 * max(float(np.abs(block).max()) for block in blocks) ** 2:
        raise no_spread(value, n, "training runs", where=where)
    freedom = variance**2 / sum(part**2 / (count - 1) for part, count in parts)
    error = sqrt(variance)
    reach = student(level, freedom) * error
    p = student_p(value / error, freedom)
    return PairedEffect(value, value - reach, value + reach, p, n)


def _no_seeds(level: float) -> float:
    """Runs on seeds of their own hold the seeds' luck already."""
    return 0.0


def _seeds_of_both(a: Scores, b: Scores) -> Callable[[float], float]:
    where = "difference_over_runs"
    one, two = crossed(a, where=where), crossed(b, where=where)
    if one is None or two is None:
        return _no_seeds
    if one.shape[1] != two.shape[1]:
        raise EvidenceError(
            "two methods didn't play the same seeds",
            where=where,
            expected="equally many episodes, column for column on one seed",
            actual=f"{one.shape[1]} and {two.shape[1]}",
            fix="play the same seeds, or say shared_seeds=False",
        )
    blocks = [Crossed(one, np.arange(len(one)), -1.0), Crossed(two, np.arange(len(two)), 1.0)]
    return reach_of_seeds(blocks, where=where)


def kept_runs(run_means: FloatArray, statistic: Statistic) -> NDArray[np.intp]:
    """The runs that a statistic of their scores [runs] rests on.

    Returns:
        [kept runs] their places.
    """
    order, n = np.argsort(run_means, kind="stable"), len(run_means)
    cut = {"mean": 0, "iqm": n // 4, "median": (n - 1) // 2}[statistic]
    return order[cut : n - cut]
