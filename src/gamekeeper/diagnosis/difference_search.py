"""The search for the differences between a good and a bad run that explain the gap.

Differences are swapped into the bad set-up one at a time, then delta debugging looks for the least
set that explains the gap; what it found is confirmed on fresh seeds that took no part.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from gamekeeper.diagnosis.arms import ArmOrder, ArmRunner, RaisedPolicy, raised_in
from gamekeeper.diagnosis.diagnosis_result import Tested
from gamekeeper.diagnosis.open_setup import Setup
from gamekeeper.diagnosis.setup_differences import SetupDifference, names_of, taken_over
from gamekeeper.episodes.outcome import Outcome
from gamekeeper.errors import GamekeeperError
from gamekeeper.statistics.paired import FEWEST, PairedEffect, paired_effect
from gamekeeper.statistics.significance import holm

BAD: Final = "bad"
GOOD: Final = "good"
AS_GOOD: Final = "as in the good run: "
ALONE: Final = 24
"""Fresh episodes on which single differences are put in order."""
CONFIRM: Final = 64
"""Fresh episodes of each arm that the answer is given on."""
ALPHA: Final = 0.05
MATTERS: Final = 0.05
"""The part of the gap from which what is left of it, beyond chance, is worth a further part."""
NEAR: Final = 0.2
"""A single difference so near the part of the gap that explains is tried by itself, too."""

Chosen = Sequence[SetupDifference]
Scores = NDArray[np.float64]
"""[episodes] 1 where an episode didn't fail; or the team's return."""


class Spent(Exception):  # noqa: N818  # no error: the search ends with what it knows
    """The budget is spent."""


@dataclass(slots=True)
class DifferenceSearch:
    """Arms on paired fresh seeds, and the least sets that explain.

    Attributes:
        differences: those that can be swapped.
        score, measure: figure of an episode, and its name; higher is better.
        part: of the gap that a set has to close.
        seeds: run seeds of the search and of the confirmation.
        alone: by name, the part of the gap that a difference closes, taken over alone.
        confirmed: sets that the answer is given on. One restores where it closes the stated part
            beyond chance, and the good set-up is no better beyond chance, or by less than matters.
        tried: names of all sets that were played.
        not_played: what the budget didn't reach, in words.
    """

    bad: Setup
    good: Setup
    differences: tuple[SetupDifference, ...]
    runner: ArmRunner
    score: Callable[[Outcome], float]
    part: float
    seeds: tuple[int, int]
    measure: str = "success"
    alone: dict[str, float] = field(default_factory=dict)
    confirmed: list[Tested] = field(default_factory=list)
    tried: set[str] = field(default_factory=set)
    not_played: list[str] = field(default_factory=list)

    def run(self) -> tuple[Chosen, ...]:
        """The least sets that explain the gap; none without a gap, or where none was confirmed."""
        confirm = self.seeds[1]
        self._scores((), confirm, CONFIRM)
        self._scores(self.differences, confirm, CONFIRM)
        if not self.differences or self.gap.low <= 0:
            return ()
        try:
            return self._found()
        except Spent:
            self.not_played.append("smaller sets of differences, and their confirmation")
            return ()

    @property
    def gap(self) -> PairedEffect:
        """The good set-up against the bad one, on the seeds that the answer is given on."""
        confirm = self.seeds[1]
        return self._effect((), self.differences, confirm, CONFIRM)

    def means(self) -> tuple[Scores, Scores]:
        """Scores of both set-ups on the seeds that the answer is given on."""
        bad = self._scores((), self.seeds[1], CONFIRM)
        good = self._scores(self.differences, self.seeds[1], CONFIRM)
        assert bad is not None  # a recorded set-up that can't be played has raised
        assert good is not None
        return bad, good

    @property
    def raised(self) -> tuple[RaisedPolicy, ...]:
        """The policies of the bad set-up that raised, on the seeds that the answer is given on."""
        return raised_in(self.runner.of(BAD, self.seeds[1], range(CONFIRM)))

    def _found(self) -> tuple[Chosen, ...]:
        ranked = self._ranked()
        for n in (FEWEST, 2 * FEWEST):  # a set that only luck on few seeds chose isn't confirmed
            least = self._confirmed(
                least_set(ranked, partial(self._explains, seed=self.seeds[0], n=n))
            )
            if least:
                enough = self.part - NEAR
                others = [o for o in ranked if self.alone.get(o.name, 0.0) >= enough]
                others = [one for one in others if one not in least]
                rivals = [(one,) for one in others if len(least) == 1]
                return (least, *(one for one in rivals if self._confirmed(one)))
        return ()

    def _ranked(self) -> list[SetupDifference]:
        """Differences by what each does alone: taken over, or taken back from the good set-up."""
        seed = self.seeds[0]
        base, best = self._mean((), seed), self._mean(self.differences, seed)
        gap = best - base
        if gap <= 0:
            return list(self.differences)
        for one in self.differences:
            self.alone[one.name] = (self._mean((one,), seed, base) - base) / gap
        order = dict(self.alone)
        if max(order.values()) < self.part + NEAR and len(order) > 2:
            for one in self.differences:
                rest = [each for each in self.differences if each is not one]
                lost = (best - self._mean(rest, seed, base)) / gap
                order[one.name] = max(order[one.name], lost)
        return sorted(self.differences, key=lambda one: -order[one.name])

    def _mean(self, chosen: Chosen, seed: int, broken: float = 0.0) -> float:
        scores = self._scores(chosen, seed, ALONE)
        return broken if scores is None else float(scores.mean())

    def _explains(self, chosen: Chosen, seed: int, n: int) -> bool:
        """It closes the part of the gap, and the good set-up isn't better."""
        base = self._scores((), seed, n)
        best = self._scores(self.differences, seed, n)
        arm = self._scores(chosen, seed, n)
        if base is None or best is None or arm is None or best.mean() <= base.mean():
            return False
        closed = float((arm.mean() - base.mean()) / (best.mean() - base.mean()))
        rest = paired_effect(arm, best, rng=np.random.default_rng(13))
        is_less = rest.low > 0 and closed <= 1 - MATTERS
        return closed >= self.part and not is_less

    def _confirmed(self, chosen: Chosen) -> tuple[SetupDifference, ...]:
        """The set without what isn't needed on fresh seeds; empty where it doesn't explain."""
        left = list(chosen)
        if not self._note(left).restores:
            return ()
        for one in list(left):
            rest = [each for each in left if each is not one]
            if rest and not self._adds(one, left) and self._note(rest).restores:
                left = rest
        return tuple(one for one in self.differences if one in left)

    def _adds(self, one: SetupDifference, chosen: Chosen) -> bool:
        """A difference closes a part of the gap that matters, beyond chance, beside the others."""
        rest = [each for each in chosen if each is not one]
        added = self._effect(rest, chosen, self.seeds[1], CONFIRM)
        return added.low > 0 and added.value >= MATTERS * self.gap.value

    def _note(self, chosen: Chosen) -> Tested:
        """A set on the seeds that the answer is given on."""
        seed = self.seeds[1]
        explains = self._explains(chosen, seed, CONFIRM)
        effect = self._effect((), chosen, seed, CONFIRM)
        # With all others at 1, Holm is Bonferroni: this set was chosen among so many.
        p = holm([effect.p, *[1.0] * (len(self.tried) - 1)])[0]
        name, is_sure = f"{AS_GOOD}{names_of(chosen)}", explains and p < ALPHA
        found = Tested.of(effect, None, name, "swap", p=p, measure=self.measure, restores=is_sure)
        self.confirmed = [x for x in self.confirmed if x.intervention != name] + [found]
        return found

    def _effect(self, one: Chosen, two: Chosen, seed: int, n: int) -> PairedEffect:
        base, arm = self._scores(one, seed, n), self._scores(two, seed, n)
        if base is None or arm is None:
            return PairedEffect(0.0, -1.0, 1.0, 1.0, n)
        return paired_effect(base, arm, rng=np.random.default_rng(13))

    def _scores(self, chosen: Chosen, seed: int, n: int) -> Scores | None:
        """Scores of the bad set-up with some differences taken over; None: it can't be played.

        Raises:
            Spent: the budget doesn't reach.
        """
        arm, setup = self._arm(chosen)
        if arm not in (BAD, GOOD):
            self.tried.add(arm)
        new = sum((arm, seed, k) not in self.runner.used for k in range(n))
        if new > self.runner.left:
            raise Spent
        if arm not in self.runner.broken:
            try:
                self.runner.play([ArmOrder(arm, setup, seed, range(n))])
            except GamekeeperError as error:
                if arm in (BAD, GOOD):
                    raise
                self.runner.broken[arm] = str(error)
        if arm in self.runner.broken:
            return None
        return np.array([self.score(x) for x in self.runner.of(arm, seed, range(n))], np.float64)

    def _arm(self, chosen: Chosen) -> tuple[str, Setup]:
        mine = [one for one in self.differences if one in chosen]
        if not mine:
            return BAD, self.bad
        if len(mine) == len(self.differences):
            return GOOD, self.good
        return f"{AS_GOOD}{names_of(mine)}", taken_over(self.bad, self.good, mine)


Item = TypeVar("Item")
Shows = Callable[[Sequence[Item]], bool]
"""Test of some of the things, in their order."""


def least_set(items: Sequence[Item], shows: Shows[Item]) -> tuple[Item, ...]:
    """The items from which none can be taken without `shows` turning false.

    First by growing a prefix, so that the likeliest should stand first, then by delta debugging
    inside it: halves, their complements, then ever smaller parts.

    Args:
        items: all of them together are taken to show it.
        shows: asked for subsets only.
    Source: Zeller & Hildebrandt 2002, "Simplifying and isolating failure-inducing input" (ddmin).
    """
    size = 1
    while size < len(items) and not shows(items[:size]):
        size *= 2
    left, parts = list(items[:size]), 2
    while len(left) >= 2:
        smaller = _smaller(left, parts, shows)
        if smaller is not None:
            left, parts = smaller
        elif parts >= len(left):
            break
        else:
            parts = min(2 * parts, len(left))
    return tuple(left)


def _smaller(items: list[Item], parts: int, shows: Shows[Item]) -> tuple[list[Item], int] | None:
    """A part that shows it, or what is left without a part; and into how many to divide it."""
    edges = [len(items) * number // parts for number in range(parts + 1)]
    spans = list(pairwise(edges))
    for begin, end in spans:
        if shows(items[begin:end]):
            return items[begin:end], 2
    for begin, end in spans if parts > 2 else ():  # of two, what is left is the other one
        rest = items[:begin] + items[end:]
        if shows(rest):
            return rest, max(parts - 1, 2)  # one part fewer, of the same size
    return None
