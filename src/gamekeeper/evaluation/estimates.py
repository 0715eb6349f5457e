"""Intervals as results have them, or the reason why there is none."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.aggregates import Aggregate, aggregate, improvement, over_environments
from gamekeeper.statistics.interval import (
    FEWEST_EPISODES,
    FloatArray,
    Interval,
    Statistic,
    no_spread,
)
from gamekeeper.statistics.one_sample import one_sample
from gamekeeper.statistics.paired import PairedEffect, paired_effect, sign_test
from gamekeeper.statistics.resampling import interquartile_mean
from gamekeeper.statistics.significance import wilson
from gamekeeper.statistics.student import student, student_p
from gamekeeper.statistics.training_runs import (
    MeetingLuck,
    difference_over_runs,
    over_meetings,
    over_runs,
)

MOST_BROKEN: Final = 0.05
"""Part of the episodes that may have broken off where the others stand for all."""
MOST_NAMED: Final = 2
"""Subjects that a refusal names; the others are counted."""
POINT: Final[dict[str, Callable[[FloatArray], Any]]] = {
    "mean": np.mean,
    "iqm": interquartile_mean,
    "median": np.median,
}


@dataclass(frozen=True, slots=True)
class Compared:
    """A comparison with what it rests on.

    Attributes:
        difference: with its interval; None where there is no figure.
        improvement: the probability that the first is above the second; None where it isn't known.
        n: pairs of episodes, or training runs.
        total: episodes that were played.
        lost: of these, how many broke off.
        seeds: that all runs have in common; None where episodes are the unit.
    """

    difference: dict[str, Any] | None
    improvement: dict[str, Any] | None
    n: int
    total: int
    lost: int
    seeds: int | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain data, as it stands in a row of comparisons."""
        used = self.n if self.seeds is None else self.seeds
        return {
            "n": self.n,
            "episodes": used,
            "of_episodes": self.total,
            "broken": self.lost,
            "difference": self.difference,
            "improvement": self.improvement,
        }


class Judge:
    """Makes intervals, and notes what was refused and why.

    Args:
        seed: with the name of what is judged it settles the resamples, so that no interval hangs
            on which others were made.
    """

    def __init__(self, level: float, seed: int) -> None:
        self.level, self._seed = level, seed
        self._refused: dict[tuple[str, str], dict[str, dict[str, None]]] = {}

    @property
    def refused(self) -> list[dict[str, str]]:
        """Refused claims, each with its reason; those with the same reason and subjects as one."""
        found: dict[tuple[str, str], list[str]] = {}
        for (what, why), subjects in self._refused.items():
            names = [
                f"{name} ({', '.join(seen)})" if seen else name
                for name, seen in subjects.items()
                if name
            ]
            named = ", ".join(names[:MOST_NAMED])
            more = len(names) - MOST_NAMED
            named += f" and {more} more" if more > 0 else ""
            found.setdefault((named, why), []).append(what)
        return [
            {"what": ", ".join(what) + (f": {named}" if named else ""), "why": why}
            for (named, why), what in found.items()
        ]

    def refuse(self, what: str, why: str, subject: str = "", actual: str = "") -> None:
        """Notes a refusal; `actual` was there in place of what an interval asks for."""
        seen = self._refused.setdefault((what, why), {}).setdefault(subject, {})
        if actual:
            seen.setdefault(actual)

    def rng(self, *name: object) -> Generator:
        """The random stream of something that has a name."""
        # By name, so that a figure's draws don't hang on which other figures are asked for.
        digest = blake2b("\0".join(map(str, name)).encode(), digest_size=8).digest()
        return np.random.default_rng([13, self._seed, int.from_bytes(digest, "little")])

    def episodes(
        self,
        values: FloatArray,
        statistic: Statistic,
        *,
        of: str,
        name: Sequence[object],
        lost: int = 0,
    ) -> dict[str, Any] | None:
        """A statistic over episodes of a checkpoint; None where there is no value.

        Args:
            values: [episodes] NaN where an episode has none.
            of: subject that a refusal names.
            name: of the random stream.
            lost: episodes without a value because they broke off.
        """
        there = values[~np.isnan(values)]
        if not len(there):
            return None
        what = f"interval of the {_shown(statistic)} over episodes"
        try:
            _enough_left(lost, len(values))
            found = one_sample(
                there, statistic=statistic, rng=self.rng(*name, statistic), level=self.level
            )
        except EvidenceError as error:
            return self._point(float(POINT[statistic](there)), error, what, of)
        return _plain(found)

    def flat(self, value: float, n: int, unit: str, *, of: str) -> dict[str, Any]:
        """A figure that is one number everywhere, so that it has no interval."""
        error = no_spread(value, n, unit, where=of)
        return self._point(value, error, "interval of a figure that never varies", of)

    def runs(
        self,
        scores: Sequence[FloatArray],
        statistic: Statistic,
        *,
        of: str,
        name: Sequence[object],
        lost: int = 0,
        is_share: bool = False,
    ) -> dict[str, Any] | None:
        """A statistic over training runs; None where a run has no value.

        Args:
            scores: of each run, [episodes] on the same seeds.
            statistic, of, name: as `episodes` takes them.
            lost: seeds on which a run broke off.
            is_share: scores are failure and success.
        """
        kept = shared(scores)
        if not kept.size:
            return None
        what = f"interval of the {_shown(statistic)} over training runs"
        try:
            _enough_left(lost, len(scores[0]))
            found = over_runs(
                kept,
                statistic=statistic,
                rng=self.rng(*name, statistic),
                level=self.level,
                is_share=is_share,
            )
        except EvidenceError as error:
            return self._point(float(POINT[statistic](kept.mean(axis=1))), error, what, of)
        return _plain(found)

    def share(self, values: FloatArray) -> dict[str, Any] | None:
        """Share of successes with Wilson's interval; None where success isn't declared."""
        there = values[~np.isnan(values)]
        if not len(there):
            return None
        hits = int(there.sum())
        found = wilson(hits, len(there), level=self.level)
        return {"hits": hits, "n": len(there), "p": found.p, "low": found.low, "high": found.high}

    def paired(
        self,
        a: FloatArray,
        b: FloatArray,
        *,
        of: str,
        name: Sequence[object],
        lost: int = 0,
        is_share: bool = False,
    ) -> Compared:
        """By how much `a` is above `b` on shared seeds, and how probably.

        Args:
            a: [episodes] of one, b: of the other; NaN where an episode has no figure.
            of, name: as `episodes` takes them.
            lost: seeds on which one of them broke off.
        """
        total = len(a)
        both = ~np.isnan(a) & ~np.isnan(b)
        a, b = a[both], b[both]
        if not len(a):
            return Compared(None, None, 0, total, lost)
        rng = self.rng(*name, "difference")
        what = "interval of a difference over episodes"
        try:
            _enough_left(lost, total)
        except EvidenceError as error:
            return Compared(
                self._point(float((a - b).mean()), error, what, of), None, len(a), total, lost
            )
        chance = self.improvement(a, b, paired=True, of=of)
        try:
            effect = paired_effect(
                b, a, rng=rng, level=self.level, is_share=is_share, fewest=FEWEST_EPISODES["mean"]
            )
            difference = {**_effect(effect), "effect_size": _in_spreads(a - b)}
        except EvidenceError as error:
            difference = self._point(float((a - b).mean()), error, what, of)
            above, below = int((a > b).sum()), int((a < b).sum())
            difference |= {"p": sign_test(above, below), "above": above, "below": below}
        return Compared(difference, chance, len(a), total, lost)

    def between_runs(
        self,
        a: Sequence[FloatArray],
        b: Sequence[FloatArray],
        *,
        of: str,
        name: Sequence[object],
        lost: int = 0,
        is_share: bool = False,
    ) -> Compared:
        """The same of methods; one that is a single checkpoint counts as it is, without spread."""
        kept, total = shared([*a, *b]), len(a[0])
        one, two = kept[: len(a)], kept[len(a) :]
        # A single checkpoint has no spread over runs: the other's runs are then the unit.
        runs = max(len(a), len(b)) if 1 in (len(a), len(b)) else min(len(a), len(b))
        if not kept.size:
            return Compared(None, None, runs, total, lost, 0)
        value, chance = float(one.mean() - two.mean()), None
        means = one.mean(axis=1), two.mean(axis=1)
        try:
            _enough_left(lost, total)
            chance = self.improvement(*means, paired=False, of=of)
            difference = self._difference_of_runs(one, two, name, is_share=is_share)
            difference["effect_size"] = _in_pooled_spreads(*means)
        except EvidenceError as error:
            what = "interval of a difference over training runs"
            difference = self._point(value, error, what, of)
        return Compared(difference, chance, runs, total, lost, kept.shape[1])

    def _difference_of_runs(
        self, one: FloatArray, two: FloatArray, name: Sequence[object], *, is_share: bool
    ) -> dict[str, Any]:
        rng = self.rng(*name, "difference")
        if min(len(one), len(two)) > 1:
            return _effect(difference_over_runs(two, one, rng=rng, level=self.level))
        found = over_runs(one - two, rng=rng, level=self.level)  # the single one against each
        return {**_plain(found), "p": _p_of(found, self.level)}

    def meetings(
        self,
        blocks: Sequence[FloatArray],
        *,
        times: float = 1.0,
        luck: MeetingLuck | None = None,
        of: str,
        lost: int = 0,
    ) -> dict[str, Any] | None:
        """The mean over meetings of runs, about new runs and new seeds.

        Args:
            blocks: by method [runs, episodes], of each run the mean over its meetings.
            times: what a run's mean is enlarged by: in how many positions its method sits.
            luck: of single meetings, where runs vary in both positions.
            lost: seeds on which a meeting broke off.
        """
        total = blocks[0].shape[1]
        there = ~np.any([np.isnan(block).any(axis=0) for block in blocks], axis=0)
        kept = [block[:, there] for block in blocks]
        if not there.any():
            return None
        try:
            _enough_left(lost, total)
            return _effect(over_meetings(kept, times=times, luck=luck, level=self.level))
        except EvidenceError as error:
            value = float(np.mean([block.mean() for block in kept]))
            return self._point(value, error, "interval of meetings of training runs", of)

    def environments(
        self,
        scores: Mapping[str, FloatArray],
        statistic: Aggregate,
        *,
        of: str,
        name: Sequence[object],
    ) -> dict[str, Any] | None:
        """A figure of a policy over environments, [runs, episodes] in each."""
        try:
            rng = self.rng(*name, statistic)
            return _plain(over_environments(scores, statistic=statistic, rng=rng, level=self.level))
        except EvidenceError as error:
            refused, what = error, f"interval of the {_shown(statistic)} over all environments"
        try:
            return self._point(aggregate(scores, statistic=statistic), refused, what, of)
        except EvidenceError as error:  # numbers of runs differ
            self._note(error, f"{_shown(statistic)} over all environments", of)
            return None

    def improvement(
        self,
        a: FloatArray | Mapping[str, FloatArray],
        b: FloatArray | Mapping[str, FloatArray],
        *,
        paired: bool,
        of: str,
    ) -> dict[str, Any] | None:
        """Probability that `a` is above `b`; None with too few values."""
        try:
            return _plain(improvement(a, b, paired=paired, level=self.level))
        except EvidenceError as error:
            unit = "episodes" if paired else "training runs"
            self._note(error, f"probability of improvement over {unit}", of)
            return None

    def _point(self, value: float, error: EvidenceError, what: str, of: str) -> dict[str, Any]:
        """The estimate alone."""
        self._note(error, what, of)
        return {"value": value, "low": None, "high": None, "method": None}

    def _note(self, error: EvidenceError, what: str, of: str) -> None:
        asked = f"; needed: {error.expected}" if error.expected else ""
        step = f". Next: {error.fix}" if error.fix else ""
        self.refuse(what, f"{error.what}{asked}{step}", of, error.actual or "")


def _enough_left(lost: int, total: int) -> None:
    """Episodes that broke off may be few: those that are left are the easier ones.

    Raises:
        EvidenceError: they are more than `MOST_BROKEN`.
    """
    if lost > MOST_BROKEN * total:
        raise EvidenceError(
            "too many episodes broke off: those that are left are no sample of all",
            expected=f"at most {100 * MOST_BROKEN:g} % broken off, or failed_return in the "
            "specification, which says what they count as",
            actual=f"{lost} of {total} episodes",
        )


def _in_spreads(differences: FloatArray) -> float | None:
    """The mean of paired differences in their standard deviations (Cohen's d_z)."""
    spread = float(differences.std(ddof=1)) if len(differences) > 1 else 0.0
    return float(differences.mean()) / spread if spread > 0 else None


def _in_pooled_spreads(a: FloatArray, b: FloatArray) -> float | None:
    """The difference of two methods in the standard deviations of their runs (Cohen's d)."""
    several = [each for each in (a, b) if len(each) > 1]
    freedom = sum(len(each) - 1 for each in several)
    squares = sum(float(each.var(ddof=1)) * (len(each) - 1) for each in several)
    if squares <= 0:
        return None
    return float(a.mean() - b.mean()) / sqrt(squares / freedom)


def shared(scores: Sequence[FloatArray]) -> FloatArray:
    """[runs, episodes] the scores of the episodes in which every run has one."""
    kept = np.stack(list(scores))
    return np.asarray(kept[:, ~np.isnan(kept).any(axis=0)])


def _plain(found: Interval) -> dict[str, Any]:
    return {"value": found.value, "low": found.low, "high": found.high, "method": found.method}


def _p_of(found: Interval, level: float) -> float:
    """The two-sided p-value that goes with an interval over runs, by Student's t."""
    spread = (found.high - found.low) / 2 / student(level, found.n - 1)
    if spread == 0:
        return 1.0 if found.value == 0 else 0.0
    return student_p(found.value / spread, found.n - 1)


def _effect(found: PairedEffect) -> dict[str, Any]:
    return {"value": found.value, "low": found.low, "high": found.high, "p": found.p}


def _shown(statistic: str) -> str:
    return {"iqm": "interquartile mean", "optimality_gap": "optimality gap"}.get(
        statistic, statistic
    )
