"""Probe of the order of an action dictionary: does another change outcomes, or only draws."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from gamekeeper.auditing.meeting import meeting
from gamekeeper.auditing.outcomes import (
    Difference,
    Key,
    digests,
    first_difference,
    numbers,
    stacked,
)
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.checks.facts.episode_facts import OrderOutcome
from gamekeeper.interface.generators import is_still
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult
from gamekeeper.rollouts.interventions.tick_order import ActionOrder, reordered
from gamekeeper.rollouts.process_randomness import kept_global_generators, reseed
from gamekeeper.statistics.significance import FloatArray, permutation_test, sign_flip_test

SAMPLES: Final = 20
"""Outcomes of each order that are drawn where copies can be had."""
FEWEST: Final = 8
"""Fewer say too little: 8 against 8 can still have a p-value of 1 / 12,870."""
ROUNDS: Final = 4_999
"""Permutations; the least p-value is 1 / 5,000, so that it survives a correction for looks."""
MOST_STATES: Final = 48
"""States at which a fault that hides behind draws is looked for."""

Numbers = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class DifferenceKind:
    """Kind of a difference.

    Attributes:
        result: `outcome` (nothing was drawn), `draws` (something was: the tests tell), `undecided`,
            `noise` (led there once more, the first order gives something else too).
        p_values: of the tests whether both orders have one distribution.
    """

    result: str
    p_values: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class FirstDivergence:
    """An episode in which the other order parts from the first.

    Attributes:
        play: its actions are scripted.
        order: the name of the other order.
        turn: steps after which the difference shows.
        seen: digests of what the first order gave there.
    """

    play: EpisodePlan
    order: str
    turn: int
    seen: Mapping[Key, bytes]

    def ordered(self, order: str, turn: int) -> dict[Any, Any]:
        """Copies of the actions of a turn, in that order; in their own where none is named."""
        actions = (self.play.actions or ())[turn]
        names = reordered(order, list(actions), turn) if order else list(actions)
        return {agent: copy.deepcopy(actions[agent]) for agent in names}


def told(session: ProbeSession, first_divergence: FirstDivergence) -> DifferenceKind:
    """Reruns the episode up to the divergence, and says what the order of the actions changes.

    Nothing was drawn: it is the outcome. Else both orders are given the same number of fresh
    random futures from the same state, and a permutation test over all numbers of the outcome says
    whether they have one distribution; where they seem to, fault that comes rarely is looked for
    at other states of the episode.
    """
    with kept_global_generators():
        drawn = _drawn(session, first_divergence)
        if not drawn:
            return DifferenceKind("noise" if drawn is None else "outcome")
        reordering = _Reordering(session, first_divergence)
        first = reordering.at_the_first_divergence()
        if first is None:
            return DifferenceKind("undecided")
        rest = reordering.elsewhere() if first > 1 / 100 else None
    return DifferenceKind("draws", (first,) if rest is None else (first, rest))


def _drawn(session: ProbeSession, first_divergence: FirstDivergence) -> bool | None:
    """True if a generator moves in the step before the divergence; None: it is mere noise."""
    found = False
    for order in ("", "", first_divergence.order):
        env = _led(session, first_divergence, first_divergence.turn - 1)
        actions = first_divergence.ordered(order, first_divergence.turn - 1)
        outs: list[Any] = []
        is_calm = is_still(env, partial(_stepped, session, env, actions, outs))
        seen = digests(outs[0], session.contract.volatile_infos())
        if not order and seen != first_divergence.seen:
            return None
        found = found or not is_calm
    return found


def _stepped(session: ProbeSession, env: Any, actions: Mapping[Any, Any], outs: list[Any]) -> None:
    outs.append(session.step(env, actions).value)


class _Reordering:
    """Samples of both orders from one state on."""

    def __init__(self, session: ProbeSession, first_divergence: FirstDivergence) -> None:
        self._session, self._first = session, first_divergence
        self._volatile = session.contract.volatile_infos()
        self._rng = np.random.default_rng([11, session.number])
        self._left = max(session.ration, 400)

    def at_the_first_divergence(self) -> float | None:
        """The p-value of both orders having one distribution there; None: it can't be known."""
        turn, session = self._first.turn, self._session
        begun = self._cause()
        env = _led(session, self._first, begun)
        can_copy = _copies_well(session, env, self._first.ordered("", begun))
        each = turn - begun if can_copy else turn
        size = min(SAMPLES, self._left // max(2 * each, 1))
        if size < FEWEST:
            return None
        found: dict[str, list[Numbers]] = {"": [], self._first.order: []}
        if can_copy:
            env = _led(session, self._first, begun)
        for number in range(size):
            for side, order in enumerate(found):
                one = copy.deepcopy(env) if can_copy else _led(session, self._first, begun)
                reseed(one, 2 * number + side)
                found[order].append(self._onward(one, begun, order))
        values = stacked([*found[""], *found[self._first.order]])
        return permutation_test(values[:size], values[size:], rng=self._rng, rounds=ROUNDS)

    def elsewhere(self) -> float | None:
        """The same over states along the episode; None where copies can't be had."""
        session, actions = self._session, self._first.play.actions or ()
        env = _led(session, self._first, 0)
        step = max(len(actions) // MOST_STATES, 1)
        pairs: list[Numbers] = []
        for turn in range(len(actions)):
            if turn % step == 0 and len(getattr(env, "agents", ())) > 1:
                begun = _led(session, self._first, 0) if turn == 0 else None
                if begun is not None and not _copies_well(session, begun, actions[0]):
                    return None
                for side, order in enumerate(("", self._first.order)):
                    one = copy.deepcopy(env)
                    reseed(one, 1_000 + 2 * turn + side)
                    pairs.append(self._numbers(one, order, turn))
            session.step(env, actions[turn])
        if len(pairs) < 2 * FEWEST:
            return None
        values = stacked(pairs)
        return sign_flip_test(values[::2] - values[1::2], rng=self._rng, rounds=ROUNDS)

    def _cause(self) -> int:
        """The step whose order makes the difference: the last before it, or all of them."""
        turn, outs = self._first.turn, []
        for order in ("", self._first.order):
            env = _led(self._session, self._first, turn - 1)
            out = self._session.step(env, self._first.ordered(order, turn - 1)).value
            outs.append(digests(out, self._volatile))
        return turn - 1 if outs[0] != outs[1] else 0

    def _onward(self, env: Any, begun: int, order: str) -> Numbers:
        last = self._first.turn - 1
        for turn in range(begun, last):
            self._session.step(env, self._first.ordered(order, turn))
        return self._numbers(env, order, last)

    def _numbers(self, env: Any, order: str, turn: int) -> Numbers:
        out = self._session.step(env, self._first.ordered(order, turn)).value
        return numbers(out, self._volatile)


def _led(session: ProbeSession, first_divergence: FirstDivergence, turns: int) -> Any:
    """An environment to which the first `turns` of the episode have happened."""
    env = session.env()
    session.meter.count()
    session.call("reset", env.reset, seed=first_divergence.play.seed)
    for turn in range(turns):
        session.step(env, first_divergence.ordered("", turn))
    return env


def _copies_well(session: ProbeSession, env: Any, actions: Mapping[Any, Any]) -> bool:
    """Tells whether a copy goes on as its original does, for a step at least."""
    copied = session.call("deepcopy", copy.deepcopy, env)
    if copied.failed is not None:
        return False
    outs = [session.step(one, copy.deepcopy(actions)) for one in (copied.value, env)]
    return outs[0].failed is None and digests(outs[0].value) == digests(outs[1].value)


def orders(count: int, play: int) -> tuple[str, ...]:
    """The orders that are tried in an episode of so many agents; reversed covers every pair."""
    return ("reversed", "shuffled") if count > 2 and play % 4 == 0 else ("reversed",)


PLAYS: Final = 4
"""Plays at least, however long; more where episodes are short."""
MOST_PLAYS: Final = 24
RUNS: Final = 2
MEETINGS: Final = 3
"""One episode of so many is random, in the others agents are brought together."""


def _order_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """Few long plays, and more where they end early and leave steps to spend."""
    return session.plays_of([max(session.ration // (PLAYS * RUNS), 20)] * MOST_PLAYS)


@probe("order", share=2.5, plays=_order_plays, api="parallel")
def order(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """The same joint actions in other orders of their dictionary, at every tick of whole episodes.

    In two episodes of three the policies bring agents together: they learn what their actions move
    in their observations, and steer to one place, or do the same for a while. Agents that choose at
    random hardly ever compete for one thing.

    The reversed order changes the places of every two agents, so one rerun looks at every conflict
    that an episode comes to.

    One fact for each episode in which at least two agents acted together.

    Facts:
        `OrderOutcome`.
    """
    seen: list[dict[Key, bytes]] = []
    volatile = session.contract.volatile_infos()
    base = session.play(
        play,
        state=False,
        watch=lambda turn, env, out: seen.append(digests(out, volatile)),
        steer=partial(meeting, session.contract) if play.stream % MEETINGS else None,
    )
    actions = base.play.actions or ()
    together = [turn for turn, each in enumerate(actions) if len(each) > 1]
    if not together:
        return
    ticks = 0
    for order in orders(max(map(len, actions)), play.stream):
        watch = _Comparing(seen, volatile)
        session.play(base.play, change=ActionOrder(order), state=False, watch=watch)
        ticks += len(together)
        if watch.turn is not None:
            yield _parted(session, base, order, watch, ticks, seen, volatile)
            return
    yield session.fact(OrderOutcome(result="same", ticks=ticks), field="rewards")


def _parted(
    session: ProbeSession,
    base: EpisodeResult,
    order: str,
    counterfactual: _Comparing,
    ticks: int,
    seen: list[dict[Key, bytes]],
    volatile: frozenset[str],
) -> Saw:
    """The fact of a difference, after a look at what is nobody's doing."""
    turn = counterfactual.turn or 0
    unchanged_rerun = _Comparing(seen, volatile, keep=turn)
    session.play(base.play, state=False, watch=unchanged_rerun)
    if unchanged_rerun.turn is not None and unchanged_rerun.turn <= turn:
        return session.fact(OrderOutcome(result="noise", ticks=ticks), field="rewards")
    found = first_difference(unchanged_rerun.out, counterfactual.out, volatile)
    found = found or Difference("agents", "", None, None, is_rounding=False)
    kind = DifferenceKind("rounding")
    if not found.is_rounding:
        kind = told(session, FirstDivergence(base.play, order, turn, seen[turn]))
    told_of = found.part, found.agent, found.one, found.two
    value = OrderOutcome(kind.result, ticks, order, turn, *told_of, kind.p_values)
    at = turn - (found.part == "rewards")
    return session.fact(value, turn=at, agent=found.agent or None, field=found.part)


class _Comparing:
    """Compares every outcome of a rerun, and keeps the first that differs, or that of a turn."""

    def __init__(
        self, seen: list[dict[Key, bytes]], volatile: frozenset[str], keep: int | None = None
    ) -> None:
        self.turn: int | None = None
        self.out: Any = None
        self._seen, self._volatile, self._keep = seen, volatile, keep

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        is_kept = turn == self._keep
        if self.turn is None:
            expected: Mapping[Key, bytes] = self._seen[turn] if turn < len(self._seen) else {}
            if digests(out, self._volatile) != expected:
                self.turn = turn
                is_kept = is_kept or self._keep is None
        if is_kept:
            self.out = copy.deepcopy(out)
