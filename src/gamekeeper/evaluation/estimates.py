"""Intervals as results have them, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.episodes.outcome import EACH, TEAM
from gamekeeper.errors import EvidenceError
from gamekeeper.evaluation.episode_rows import LENGTH, RETURN, ROLE, SUCCESS, Sheet
from gamekeeper.evaluation.inspection import Inspection
from gamekeeper.evaluation.matchups import Checkpoint
from gamekeeper.evaluation.spec import Spec
from gamekeeper.statistics.aggregates import Aggregate, aggregate, improvement, over_environments
from gamekeeper.statistics.confidence_sequence import Narrowing
from gamekeeper.statistics.interval import FEWEST_RUNS_APART, Interval, Statistic, enough
from gamekeeper.statistics.one_sample import one_sample
from gamekeeper.statistics.paired import PairedEffect, paired_effect
from gamekeeper.statistics.resampling import interquartile_mean
from gamekeeper.statistics.significance import wilson
from gamekeeper.statistics.student import student, student_p
from gamekeeper.statistics.training_runs import difference_over_runs, over_runs

FloatArray = NDArray[np.float64]

MOST_NAMED: Final = 6
"""Episodes that a refusal names; the others are counted."""
POINT: Final[dict[str, Callable[[FloatArray], Any]]] = {
    "mean": np.mean,
    "iqm": interquartile_mean,
    "median": np.median,
}


class Judge:
    """Makes intervals, and notes what was refused and why.

    Args:
        level: of all intervals.
        seed: with the name of what is judged it settles the resamples, so that no interval hangs
            on which others were made.
    """

    def __init__(self, level: float, seed: int) -> None:
        self.level, self._seed = level, seed
        self._refused: dict[tuple[str, str], dict[str, None]] = {}

    @property
    def refused(self) -> list[dict[str, str]]:
        """Refused claims, each with its reason."""
        found = []
        for (what, why), whom in self._refused.items():
            names = [name for name in whom if name]
            named = ", ".join(names[:MOST_NAMED])
            more = len(names) - MOST_NAMED
            named += f" and {more} more" if more > 0 else ""
            found.append({"what": f"{what}: {named}" if named else what, "why": why})
        return found

    def refuse(self, what: str, why: str, whom: str = "") -> None:
        """Notes a refusal."""
        self._refused.setdefault((what, why), {}).setdefault(whom)

    def rng(self, *name: object) -> Generator:
        """The random stream of something that has a name."""
        digest = blake2b("\0".join(map(str, name)).encode(), digest_size=8).digest()
        return np.random.default_rng([13, self._seed, int.from_bytes(digest, "little")])

    def episodes(
        self, values: FloatArray, statistic: Statistic, *, of: str, name: Sequence[object]
    ) -> dict[str, Any] | None:
        """A statistic over episodes of a checkpoint; None where there is no value.

        Args:
            values: [episodes] NaN where an episode has none.
            of: whom a refusal names.
            name: of the random stream.
        """
        there = values[~np.isnan(values)]
        if not len(there):
            return None
        what = f"interval of the {_shown(statistic)} over episodes"
        try:
            found = one_sample(
                there, statistic=statistic, rng=self.rng(*name, statistic), level=self.level
            )
        except EvidenceError as error:
            return self._point(float(POINT[statistic](there)), error, what, of)
        return _plain(found)

    def runs(
        self, scores: Sequence[FloatArray], statistic: Statistic, *, of: str, name: Sequence[object]
    ) -> dict[str, Any] | None:
        """A statistic over training runs; None where a run has no value.

        Args:
            scores: of each run, [episodes] on the same seeds.
        """
        kept = shared(scores)
        if not kept.size:
            return None
        what = f"interval of the {_shown(statistic)} over training runs"
        try:
            found = over_runs(
                kept, statistic=statistic, rng=self.rng(*name, statistic), level=self.level
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
        self, a: FloatArray, b: FloatArray, *, of: str, name: Sequence[object]
    ) -> tuple[dict[str, Any] | None, dict[str, Any] | None, int]:
        """By how much `a` is above `b` on shared seeds, how probably, and on how many."""
        both = ~np.isnan(a) & ~np.isnan(b)
        a, b = a[both], b[both]
        if not len(a):
            return None, None, 0
        try:
            effect = paired_effect(b, a, rng=self.rng(*name, "difference"), level=self.level)
            difference = _effect(effect)
        except EvidenceError as error:
            difference = self._point(
                float((a - b).mean()), error, "interval of a difference over episodes", of
            )
        return difference, self.improvement(a, b, paired=True, of=of), len(a)

    def between_runs(
        self, a: Sequence[FloatArray], b: Sequence[FloatArray], *, of: str, name: Sequence[object]
    ) -> tuple[dict[str, Any] | None, dict[str, Any] | None, int]:
        """The same of methods; one that is a single checkpoint counts as it is, without spread."""
        kept = shared([*a, *b])
        one, two = kept[: len(a)], kept[len(a) :]
        if not kept.size:
            return None, None, 0
        what = "interval of a difference over training runs"
        value = float(one.mean() - two.mean())
        try:
            if min(len(a), len(b)) == 1:
                apart = one - two if len(two) == 1 else -(two - one)
                found = over_runs(apart, rng=self.rng(*name, "difference"), level=self.level)
                difference = {**_plain(found), "p": _p_of(found, self.level)}
            else:
                difference = _effect(
                    difference_over_runs(
                        two, one, rng=self.rng(*name, "difference"), level=self.level
                    )
                )
        except EvidenceError as error:
            difference = self._point(value, error, what, of)
        chance = self.improvement(one.mean(axis=1), two.mean(axis=1), paired=False, of=of)
        return (
            difference,
            chance,
            max(len(a), len(b)) if 1 in (len(a), len(b)) else min(len(a), len(b)),
        )

    def meetings(
        self, scores: Sequence[Sequence[float]], *, times: float, of: str
    ) -> dict[str, Any] | None:
        """The mean over meetings of runs, by how much it varies with the runs of each method.

        Meetings share runs, so that they aren't a sample; runs are. The mean's variance is that of
        a U-statistic: of each method, the variance of its runs' means over their meetings.

        Args:
            scores: by method, of each run the mean over its meetings.
            times: what a run's mean is enlarged by: in how many seats its method sits.
        Source: van der Vaart 1998, "Asymptotic statistics", ch. 12 (Hajek projection of one- and
            two-sample U-statistics); Welch 1947 for the degrees of freedom.
        """
        value = float(np.mean([np.mean(each) for each in scores]))
        parts = [
            (times**2 * float(np.var(each, ddof=1)) / len(each), len(each) - 1)
            for each in scores
            if len(each) > 1
        ]
        what = "interval of a cell over training runs"
        try:
            for each in scores:
                enough(len(each), FEWEST_RUNS_APART, "training runs", where=of)
        except EvidenceError as error:
            return self._point(value, error, what, of)
        variance = sum(part for part, _ in parts)
        freedom = variance**2 / sum(part**2 / n for part, n in parts) if variance > 0 else 1.0
        reach = student(self.level, freedom) * sqrt(variance)
        method = "Student's t on runs that meet one another (U-statistic)"
        return {"value": value, "low": value - reach, "high": value + reach, "method": method}

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
        asked = f"; {error.expected}" if error.expected else ""
        self.refuse(what, f"{error.what}{asked}", f"{of} ({error.actual})" if error.actual else of)


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


@dataclass(slots=True)
class Stopping:
    """Values so far, by environment and checkpoint.

    Attributes:
        spec: with a `stop`.
        looks: of the environments.
        seen: [episodes] figures, in the order of their numbers.
        rounds: how often it was looked.
    """

    spec: Spec
    looks: Mapping[str, Inspection]
    seen: dict[tuple[str, Checkpoint], FloatArray] = field(default_factory=dict)
    rounds: int = 0

    @property
    def sequence(self) -> Narrowing:
        """The intervals: of shares bounded ones, of everything else those without bounds."""
        if self._stop.metric == SUCCESS:
            return Narrowing(least=0.0, most=1.0, level=self.spec.level)
        return Narrowing(level=self.spec.level)

    @property
    def _stop(self) -> Any:
        return self.spec.stop

    def take(self, environment: str, side: Checkpoint, sheet: Sheet) -> None:
        """Takes the next episodes of a checkpoint.

        Raises:
            EvidenceError: they have no such figure.
        """
        scope = self._scope(environment)
        values = sheet.values(self._stop.metric, scope, self._stop.who)
        if np.isnan(values).any():
            named = {RETURN, LENGTH, SUCCESS, *sheet.metrics(None, self.spec.infos)}
            raise EvidenceError(
                "an episode lacks the figure by which playing is to stop",
                where=f"stop, {environment}",
                expected=", ".join(sorted(named)),
                actual=f"{self._stop.metric} of {self._stop.who}",
                fix="name a figure that every episode has; an exception leaves an episode none",
            )
        before = self.seen.get((environment, side), np.empty(0))
        self.seen[environment, side] = np.concatenate([before, values])

    def is_enough(self) -> bool:
        """Tells whether every interval is narrow enough."""
        self.rounds += 1
        return all(
            row["width"] is not None and row["width"] <= self._stop.width
            for row in self.sequences()
        )

    def sequences(self) -> list[dict[str, Any]]:
        """The interval of each checkpoint as it stands."""
        return [
            {
                "environment": environment,
                "policy": side.policy,
                "run": side.run,
                **self._interval(values),
            }
            for (environment, side), values in self.seen.items()
        ]

    def _interval(self, values: FloatArray) -> dict[str, Any]:
        """An interval and its width; none before there are enough values for one."""
        try:
            found = self.sequence.interval(values)
        except EvidenceError:
            mean = float(values.mean())
            nothing = dict.fromkeys(("low", "high", "width", "method"))
            return {"n": len(values), "value": mean, **nothing}
        return {
            "n": found.n,
            "value": found.value,
            "low": found.low,
            "high": found.high,
            "width": found.high - found.low,
            "method": found.method,
        }

    def to_json(self, episodes: int) -> dict[str, Any]:
        """As the document has it."""
        stop, sequences = self._stop, self.sequences()
        widths = [row["width"] for row in sequences]
        return {
            "metric": stop.metric,
            "who": stop.who,
            "width": stop.width,
            "most": stop.most,
            "rounds": self.rounds,
            "episodes": episodes,
            "level": self.spec.level,
            "reached": all(width is not None and width <= stop.width for width in widths),
            "sequences": sequences,
        }

    def _scope(self, environment: str) -> str:
        who, look = self._stop.who, self.looks[environment]
        if who == TEAM:
            return TEAM
        if who in look.role_names:
            return ROLE
        if who in look.roles:
            return EACH
        raise EvidenceError(
            "there is nobody of this name",
            where=f"stop.who, {environment}",
            expected=", ".join([TEAM, *look.role_names, *look.roles]),
            actual=who,
            fix="name the team, a role or an agent of this environment",
        )
