"""The experiment behind a diagnosis: search on some fresh seeds, confirm on others.

Every episode that it plays counts against its budget. An arm is played with all its episodes or not
at all, as fewer would say less than the answer claims; what was left out is in `not_played`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import blake2b
from itertools import combinations, product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.diagnosis.arms import MOST, ArmOrder, ArmRunner, RaisedPolicy, raised_in
from gamekeeper.diagnosis.difference_search import least_set
from gamekeeper.diagnosis.judgement import ScopeFinding, cut_early, is_failing, judged, recovered
from gamekeeper.diagnosis.open_setup import Setup
from gamekeeper.diagnosis.perturbations import PerturbationArm
from gamekeeper.diagnosis.trials import (
    COMPONENTS,
    CUT_OFF,
    MEMORY,
    IdealSubstitute,
    briefly,
    joined,
    over_undos,
    weakened,
)
from gamekeeper.episodes.outcome import TEAM, Outcome, failed, members_of
from gamekeeper.rollouts.interventions.perturbation import Perturbation as Strong

UNCHANGED: Final = "unchanged"
EVERYTHING: Final = "everything"
SEARCH: Final = 24
"""Fresh episodes on which it is settled what is worth confirming."""
CONFIRM: Final = 64
"""Fresh episodes of each arm that the answer is given on; as many again where they don't tell."""
PROMISING: Final = 0.35
"""The part of the gap that all substitutes have to close in the search, for pairs to be tried."""
LEAST: Final = 100
"""Least budget: the unchanged set-up takes `SEARCH` and `CONFIRM` episodes."""
NEAR: Final = 0.2
"""An ideal substitute so near the part of the gap that restores could be on either side of it."""
SLACK: Final = 0.15
"""The part of the gap by which fewer substitutes may do less than all of their kind, by chance."""
BEGUN: Final = 2
"""Episodes of an arm that tell how long its others are."""
MOST_PAIRS: Final = 24
"""Pairs that are searched, those that do most first."""
PAIRS: Final = 3
"""Pairs that are confirmed."""


@dataclass(slots=True)
class Experiment:
    """Arms on fresh seeds, and what they say.

    Attributes:
        setup: as it was recorded.
        substitutes: the handles, and those of each component together.
        conditions: when an episode failed, by scope.
        expected, part: as `judged` has them.
        seed: all seeds come from it and from the run's fingerprint.
        pairs: those that are confirmed, and least sets that were shrunk from a group.
        least: names of groups of which nothing can be left out.
        groups: sets that were tried while a group was shrunk, and undos in pairs, by name.
        confirmed: names of the arms that the answers are given on.
        open_scopes: those that fail beyond chance, and whose cause undos are to find.
        failing: searched episodes that failed for one of these.
        skipped: the ideal substitutes that the budget didn't reach.
        not_played: what the budget didn't reach, in words.
        renewals: fresh objects of policies in each episode, tried among the undos.
        undos: undos from outside, and policies of peers, that are confirmed.
        dropped: number of undos and memory resets that the search dropped.
        paired: number of pairs of undos that were tried.
        acquitted: agents with another policy in whose place the same undo is needed.
        sound_ways: speakers and listeners whose messages arrive as they are said.
        rivals: those that restored in the search, and weren't confirmed for want of budget.
        recordings: episodes of each arm that are recorded into a run.
        early_cut: the turn at which every failed recorded episode was truncated, if that is before
            the declared horizon.
    """

    setup: Setup
    substitutes: Sequence[IdealSubstitute]
    contract: Contract
    conditions: Mapping[str, Failure]
    runner: ArmRunner
    expected: float
    part: float
    seed: int
    fingerprint: str
    confirm: int = CONFIRM
    renewals: Sequence[IdealSubstitute] = ()
    pairs: list[IdealSubstitute] = field(default_factory=list)
    least: set[str] = field(default_factory=set)
    groups: dict[str, IdealSubstitute] = field(default_factory=dict)
    confirmed: list[str] = field(default_factory=list)
    undos: list[IdealSubstitute] = field(default_factory=list)
    dropped: int = 0
    paired: int = 0
    acquitted: set[str] = field(default_factory=set)
    sound_ways: frozenset[tuple[str, str]] = frozenset()
    rivals: list[IdealSubstitute] = field(default_factory=list)
    open_scopes: list[str] = field(default_factory=list)
    failing: list[int] = field(default_factory=list)
    skipped: list[IdealSubstitute] = field(default_factory=list)
    not_played: list[str] = field(default_factory=list)
    recordings: int = 0
    early_cut: int | None = None

    # -- seeds

    @property
    def search_seed(self) -> int:
        """The run seed of episodes that are searched on."""
        return fresh_seed(self.fingerprint, self.seed, "search")

    @property
    def confirm_seed(self) -> int:
        """The run seed of episodes that took no part in the search."""
        return fresh_seed(self.fingerprint, self.seed, "confirm")

    # -- rounds

    def run(self) -> None:
        """Plays what the answers need, as far as the budget goes."""
        self._play([UNCHANGED], self.search_seed, SEARCH)
        self._play([UNCHANGED], self.confirm_seed, CONFIRM)
        if not self.substitutes or not self.fails or self.is_broken_off:
            return
        singles = self._names(self.substitutes)
        if len(singles) > 1:
            singles.append(EVERYTHING)
        if (SEARCH + CONFIRM) * len(singles) <= self.runner.left:
            self._search(singles)
            singles = self._worth_confirming(singles)
        elif CONFIRM * len(singles) <= self.runner.left:
            self.not_played.append("the search for pairs, and for settings that still restore")
        else:
            singles = self._first_singles(self.runner.left // CONFIRM)
        self.confirmed = [*singles, *self._names(self.pairs)]
        self._play(self.confirmed, self.confirm_seed, CONFIRM)
        while self._is_near():
            if self.confirm * (1 + len(self.confirmed)) > self.runner.left:
                self.not_played.append("more episodes of arms whose effect is near --part")
                break
            self.confirm *= 2
            self._play([UNCHANGED, *self.confirmed], self.confirm_seed, self.confirm)

    def _search(self, singles: Sequence[str]) -> None:
        """Searches single ideal substitutes; pairs as far as they can be confirmed too."""
        self._play(singles, self.search_seed, SEARCH)
        shrunk = [self._shrunk(one.parts) for one in self.substitutes if one.parts]
        self._search_pairs(singles)
        if EVERYTHING in singles and not any(map(self._restores, self._names(self.pairs))):
            leaves = [one for one in self.substitutes if not one.parts]
            whole = EVERYTHING if not any(map(self._restores, singles[:-1])) else None
            shrunk.append(self._shrunk(leaves, whole) if whole else None)
        self.pairs += [one for one in shrunk if one is not None]

    def _worth_confirming(self, singles: Sequence[str]) -> list[str]:
        """The same without memory resets that did little in the search, and all at once of those.

        Nobody declared them, so that an answer needs no effect of theirs.
        """
        idle = [
            one.name
            for one in self.substitutes
            if one.component == MEMORY and self._most(one.name) < PROMISING
        ]
        left = [name for name in singles if name not in idle]
        if left == [EVERYTHING] and self._most(EVERYTHING) < PROMISING:
            left = []
        self.dropped = len(idle)
        return left

    def _shrunk(
        self, parts: Sequence[IdealSubstitute], whole: str | None = None
    ) -> IdealSubstitute | None:
        """The least of several that do together what all of them do, on searched seeds.

        None where it is one alone, or all of a group, which is noted in `least`.

        Args:
            whole: name of the arm with all of them; None: found by its parts.
        """
        names = self._names(parts)
        wholes = [one.name for one in self.substitutes if self._names(one.parts) == names]
        arm = whole or wholes[0]
        if not self._restores(arm):
            return None
        enough = max(self.part, self._most(arm) - SLACK)
        ranked = sorted(parts, key=lambda one: -self._most(one.name))
        least = least_set(ranked, partial(self._do_together, enough=enough))
        if len(least) == len(parts):
            self.least.add(arm)
        if not 1 < len(least) < len(parts):
            return None
        found = joined([one for one in parts if one in least])
        self.least.add(found.name)
        return found

    def _do_together(self, parts: Sequence[IdealSubstitute], *, enough: float) -> bool:
        """Several close enough of the gap; False where the budget doesn't reach to try them."""
        if len(parts) == 1:
            return self._most(parts[0].name) >= enough
        one = joined(parts)
        self.groups[one.name] = one
        if self.runner.left < SEARCH + CONFIRM * (len(self.substitutes) + 2):
            self.not_played.append(f"fewer at once than {one.name}")
            return False
        self._play([one.name], self.search_seed, SEARCH)
        return self._most(one.name) >= enough

    def _restores(self, arm: str) -> bool:
        return self._most(arm) >= self.part

    def _most(self, arm: str) -> float:
        """The part of the gap that an arm closes on searched seeds, where it closes most."""
        return max(self._recovered(arm, scope) for scope in self.scopes)

    def _search_pairs(self, singles: Sequence[str]) -> None:
        """Pairs of different components, where no single one does clearly enough."""
        if len(singles) < 2 or not self._wants_pairs():
            return
        pairs = self._possible_pairs()
        left = self.runner.left - CONFIRM * len(singles)
        most = (left - CONFIRM * PAIRS) // SEARCH
        most = most if most >= PAIRS else left // (SEARCH + CONFIRM)
        few = pairs[:most]
        if len(few) < len(pairs):
            self.not_played.append(
                f"{len(pairs) - len(few)} of {len(pairs)} pairs of ideal substitutes"
            )
        self._play(self._names(few), self.search_seed, SEARCH)
        self.pairs = self._best(few)

    def _first_singles(self, most: int) -> list[str]:
        """So many ideal substitutes: first the widest one of each component, then the next."""
        places: dict[str, int] = {}
        place = {}
        for one in sorted(self.substitutes, key=lambda one: -len(one.steps)):
            place[one.name] = places[one.component] = places.get(one.component, -1) + 1
        ranked = sorted(self.substitutes, key=lambda one: place[one.name])
        self.skipped = ranked[most:]
        if self.skipped:
            each = ", each alone" * (len(self.skipped) > 1)
            names = ", ".join(briefly(self.skipped))
            self.not_played.append(f"ideal substitutes{each}: {names}")
        if len(self.substitutes) > 1:
            self.not_played.append("several ideal substitutes at once")
        return self._names(ranked[:most])

    def play(self, arms: Sequence[str], run_seed: int, episodes: Sequence[int]) -> None:
        """Plays episodes of arms, as far as they aren't known yet.

        With a budget of env steps an arm is begun, and played on only if that is affordable.
        """
        orders = [ArmOrder(a, self.arm(a), run_seed, episodes) for a in arms]
        budget = self.runner.budget
        if budget is not None:
            orders = [order for order in orders if self._is_affordable(order, budget)]
        self.runner.play(orders)

    def confirm_arms(self, arms: Sequence[IdealSubstitute]) -> None:
        """Plays arms on the seeds that the answers are given on."""
        names = self._names(arms)
        self.confirmed = [*self.confirmed, *names]
        self._play(names, self.confirm_seed, self.confirm)

    def _is_affordable(self, order: ArmOrder, budget: int) -> bool:
        """Tells whether an arm is affordable by the length of its first few episodes."""
        runner, arm, seed = self.runner, order.arm, order.run_seed
        new = [k for k in order.episodes if (arm, seed, k) not in runner.used]
        if arm == UNCHANGED or arm in runner.broken or not new:
            return True
        runner.play([replace(order, episodes=new[:BEGUN])])
        if arm in runner.broken:
            return True
        longest = max(outcome.turns for outcome in runner.of(arm, seed, new[:BEGUN]))
        left = budget - runner.steps - runner.extra * runner.longest
        if left >= longest * (len(new) - BEGUN):
            return True
        runner.broken[arm] = f"the budget of {budget:,} env steps was reached"
        self.not_played.append(arm)
        return False

    def _play(self, arms: Sequence[str], run_seed: int, episodes: int) -> None:
        self.play(arms, run_seed, range(episodes))

    def arm(self, name: str) -> Setup:
        """The set-up of an arm."""
        if name == UNCHANGED:
            return self.setup
        if name == EVERYTHING:
            return joined(self.substitutes).applied(self.setup)
        others = (*self._possible_pairs(), *self.groups.values(), *self.undos)
        known = {one.name: one for one in (*self.substitutes, *others)}
        return known[name].applied(self.setup)

    # -- pairs

    def _wants_pairs(self) -> bool:
        """All ideal substitutes at once help, and no single one does clearly enough."""
        for scope in self.scopes:
            parts = [self._recovered(one.name, scope) for one in self.substitutes]
            whole = self._recovered(EVERYTHING, scope)
            if whole >= PROMISING and max(parts) < self.part + NEAR:
                return True
        return False

    def _possible_pairs(self) -> list[IdealSubstitute]:
        """Pairs of components: each as a whole, and where it has several handles each of those."""
        units: dict[str, list[IdealSubstitute]] = {}
        for one in self.substitutes:
            if one.component != CUT_OFF:  # more time makes up for anything that is slow
                units.setdefault(one.component, []).append(one)
        known = [component for component in COMPONENTS if component in units]
        pairs = [
            joined(pair)
            for one, two in combinations(known, 2)
            for pair in product(units[one], units[two])
        ]
        return sorted(pairs, key=lambda pair: -len(pair.steps))[:MOST_PAIRS]

    def _best(self, pairs: Sequence[IdealSubstitute]) -> list[IdealSubstitute]:
        """Those that restore in the search, the smallest first, before those that come near."""

        def rank(pair: IdealSubstitute) -> tuple[bool, int, float]:
            most = self._most(pair.name)
            return most < self.part, len(pair.steps), -most

        return sorted(pairs, key=rank)[:PAIRS]

    # -- what is known

    @property
    def scopes(self) -> tuple[str, ...]:
        """For whom the conditions say whether an episode failed."""
        outcomes = self.runner.of(UNCHANGED, self.search_seed, range(SEARCH))
        named = [name for each in outcomes for name in failed(each, self.conditions, self.contract)]
        return tuple(dict.fromkeys(named))

    @property
    def fails(self) -> bool:
        """For somebody the set-up fails more often than declared, beyond chance."""
        return any(map(self.is_failing, self.scopes))

    @property
    def raised(self) -> tuple[RaisedPolicy, ...]:
        """The policies that raised with nothing changed."""
        return raised_in(self.unchanged())

    @property
    def is_broken_off(self) -> bool:
        """Most of the failed episodes were broken off by a policy that raised."""
        count = sum(each.count for each in self.raised)
        bad = [failed(each, self.conditions, self.contract) for each in self.unchanged()]
        return count > 0 and count >= MOST * sum(any(each.values()) for each in bad)

    def unchanged(self) -> list[Outcome]:
        """Outcomes with nothing changed, on the seeds that the answer is given on."""
        return self.runner.of(UNCHANGED, self.confirm_seed, range(self.confirm))

    def successes(self, arm: str, run_seed: int, episodes: int, scope: str) -> NDArray[np.float64]:
        """[episodes] 1 where an episode of the arm didn't fail for the scope."""
        outcomes = self.runner.of(arm, run_seed, range(episodes))
        return np.array([self.success(each, scope) for each in outcomes], np.float64)

    def finding(self, scope: str) -> ScopeFinding:
        """The answer for a scope, on the seeds that took no part in the search."""
        seed, n = self.confirm_seed, self.confirm
        unchanged = self.successes(UNCHANGED, seed, n, scope)
        played = [one for one in (*self.substitutes, *self.pairs) if self._is_played(one.name)]
        undos = [
            self._told(one)
            for one in self.undos
            if self._is_played(one.name) and not self.is_at_cost(one, seed, range(n), scope)
        ]
        one_is_all = len(self.substitutes) == 1 and bool(played)
        whole = None
        if one_is_all or self._is_played(EVERYTHING):
            whole = self.successes(played[0].name if one_is_all else EVERYTHING, seed, n, scope)
        every = over_undos((*played, *undos))
        found = judged(
            unchanged,
            {one: self.successes(one.name, seed, n, scope) for one in every},
            least=self.least,
            expected=self.expected,
            part=self.part,
            everything=whole,
            skipped=self.skipped,
            limit=self.runner.limit,
            dropped=self.dropped,
            paired=self.paired,
            acquitted=self.acquitted,
            rng=np.random.default_rng([11, self.seed]),
        )
        return cut_early(found, self.early_cut, self.contract.schedule.horizon)

    def _told(self, one: IdealSubstitute) -> IdealSubstitute:
        """The same; of messages only one side's where the other is acquitted, and their way."""
        speaker, *others = one.between or ("",)
        is_sound = {(speaker, other) for other in others} <= self.sound_ways
        return replace(one, between=()) if is_sound and self.acquitted & {*one.between} else one

    def is_at_cost(
        self, one: IdealSubstitute, run_seed: int, episodes: Sequence[int], scope: str
    ) -> bool:
        """Tells whether an undo helps others than its agents, whose own return falls by it.

        Where a condition is of some agents, a rival that plays worse meets it too, and that is no
        repair.
        """
        arm = self.runner.of(one.name, run_seed, episodes)
        figures = [name for condition in self.conditions.values() for name in condition.names]
        names = [name.partition(".")[0] for name in figures if "." in name]
        names = names if scope == TEAM else [scope]
        agents = list(arm[0].returns) if arm else []
        judged_ones = {a for name in names for a in members_of(name, agents, self.contract)}
        if not one.agents or not judged_ones or judged_ones & {*one.agents}:
            return False
        base = self.runner.of(UNCHANGED, run_seed, episodes)
        totals = [
            sum(each.returns.get(agent, 0.0) for each in outcomes for agent in one.agents)
            for outcomes in (base, arm)
        ]
        return totals[1] < totals[0]

    def fresh(self, scope: str) -> tuple[int, int]:
        """Number of unchanged fresh episodes that failed for a scope, and of how many."""
        unchanged = self.successes(UNCHANGED, self.confirm_seed, self.confirm, scope)
        return len(unchanged) - int(unchanged.sum()), len(unchanged)

    def flips_at(self, substitute: IdealSubstitute, scope: str, *, steps: int = 4) -> float | None:
        """The worst setting of a knob at which most episodes that its ideal rescues still succeed.

        By bisection between the ideal and the recorded value, on the searched seeds alone.
        """
        ideal = substitute.steps[0][3]
        is_played = (substitute.name, self.search_seed, SEARCH - 1) in self.runner.used
        if substitute.value is None or not is_played or len(substitute.steps) > 1:
            return None
        if not isinstance(ideal, int | float):
            return None
        unchanged = self.successes(UNCHANGED, self.search_seed, SEARCH, scope)
        cured = self.successes(substitute.name, self.search_seed, SEARCH, scope)
        rescued = (cured > unchanged).nonzero()[0].tolist()
        if not rescued:
            return None
        good, bad = float(ideal), substitute.value
        is_whole = isinstance(ideal, int) and float(bad).is_integer()
        for step in range(steps):
            middle = (good + bad) / 2
            middle = float(round(middle)) if is_whole else middle
            if middle in (good, bad):
                break
            if self.runner.left < SEARCH:
                self.not_played.append(
                    f"settings between {substitute.name} and {substitute.value:g}"
                )
                return good if step else None
            one = weakened(substitute, int(middle) if is_whole else middle)
            still = self._share(one.name, one.applied(self.setup), scope, rescued)
            if still is None:
                return None
            good, bad = (middle, bad) if still > 0.5 else (good, middle)
        return good

    def _share(self, arm: str, setup: Setup, scope: str, episodes: Any) -> float | None:
        """The part of some searched episodes that succeed in a set-up; None: it can't be played."""
        self.runner.play([ArmOrder(arm, setup, self.search_seed, range(SEARCH))])
        if arm in self.runner.broken:
            return None
        return float(self.successes(arm, self.search_seed, SEARCH, scope)[episodes].mean())

    def breaks_at(
        self, perturbation: PerturbationArm, scope: str, *, steps: int = 4
    ) -> float | None:
        """Least strength of a perturbation with which most episodes that succeed do so no longer.

        By bisection from nothing to its usual strength, on the searched seeds alone; None where
        the usual strength doesn't break them, or they fail as it is, or it has no strength.
        """
        change, cost = perturbation.setup.change, SEARCH * (steps + 1)
        sound = self.successes(UNCHANGED, self.search_seed, SEARCH, scope).nonzero()[0]
        if not isinstance(change, Strong) or len(sound) <= SEARCH // 2:
            return None
        if cost > self.runner.left:
            self.not_played.append(f"strengths of {perturbation.name}")
            return None

        def breaks(strength: float) -> bool:
            one = replace(perturbation.setup, change=change.at(strength, change.agents))
            share = self._share(f"{perturbation.name} at {strength:g}", one, scope, sound)
            return share is not None and share < 0.5

        if not breaks(change.strength):
            return None
        low, high = 0.0, change.strength
        for _ in range(steps):
            middle = change.at((low + high) / 2, change.agents).strength
            if middle in (low, high):
                break
            low, high = (low, middle) if breaks(middle) else (middle, high)
        return high

    def success(self, outcome: Outcome, scope: str) -> float:
        """Returns 1 where an episode didn't fail for the scope."""
        return float(not failed(outcome, self.conditions, self.contract).get(scope, False))

    def is_failing(self, scope: str) -> bool:
        """For a scope the set-up fails more often than declared, beyond chance."""
        unchanged = self.successes(UNCHANGED, self.confirm_seed, self.confirm, scope)
        return is_failing(unchanged, self.expected)

    def _recovered(self, arm: str, scope: str) -> float:
        if arm in self.runner.broken:
            return 0.0
        unchanged = self.successes(UNCHANGED, self.search_seed, SEARCH, scope)
        played = self.successes(arm, self.search_seed, SEARCH, scope)
        return recovered(unchanged, played, self.expected)

    def _is_near(self) -> bool:
        """Some ideal substitute is so near the threshold that more episodes would tell."""
        for scope in self.scopes:
            finding = self.finding(scope)
            near = any(
                abs(one.recovered - self.part) < NEAR and one.substitute.cut_off != "later"
                for one in finding.tried  # a later cut-off yields to whatever else restores
            )
            if near and finding.answer in ("ambiguous", "joint", "unexplained"):
                return self.is_failing(scope)
        return False

    def _is_played(self, arm: str) -> bool:
        return arm in self.confirmed and arm not in self.runner.broken

    @staticmethod
    def _names(substitutes: Sequence[IdealSubstitute]) -> list[str]:
        return [one.name for one in substitutes]


def fresh_seed(fingerprint: str, seed: int, purpose: str) -> int:
    """A run seed for a purpose, apart from those of other purposes and of the recording."""
    text: Any = f"{purpose} {seed} {fingerprint}".encode()
    return int.from_bytes(blake2b(text, digest_size=6).digest(), "big")
