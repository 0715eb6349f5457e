"""Probe of the order of an action dictionary."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, Final

from gamekeeper.auditing.meeting import meeting
from gamekeeper.auditing.outcomes import Difference, Key, digests, first_difference
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.reordering import FirstDivergence, orders, told
from gamekeeper.checks.facts.play_facts import OrderOutcome
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult
from gamekeeper.rollouts.interventions.tick_order import ActionOrder

PLAYS: Final = 4
"""Plays at least, however long; more where episodes are short."""
MOST_PLAYS: Final = 24
RUNS: Final = 2
MEETINGS: Final = 3
"""One play of so many is random, in the others agents are brought together."""


def _order_plays(lab: ProbeSession) -> Iterator[EpisodePlan]:
    """Few long plays, and more where they end early and leave steps to spend."""
    return lab.plays_of([max(lab.ration // (PLAYS * RUNS), 20)] * MOST_PLAYS)


@probe("order", share=2.5, plays=_order_plays, api="parallel")
def order(lab: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """The same joint actions in other orders of their dictionary, at every tick of whole episodes.

    In two plays of three the policies bring agents together: they learn what their actions move in
    their observations, and steer to one place, or do the same for a while. Agents that choose at
    random hardly ever compete for one thing.

    The reversed order changes the places of every two agents, so one rerun looks at every conflict
    that a play comes to.

    One fact for each play in which at least two agents acted together.

    Facts:
        `OrderOutcome`.
    """
    seen: list[dict[Key, bytes]] = []
    volatile = lab.contract.volatile_infos()
    base = lab.play(
        play,
        state=False,
        watch=lambda turn, env, out: seen.append(digests(out, volatile)),
        steer=partial(meeting, lab.contract) if play.stream % MEETINGS else None,
    )
    actions = base.play.actions or ()
    together = [turn for turn, each in enumerate(actions) if len(each) > 1]
    if not together:
        return
    ticks = 0
    for order in orders(max(map(len, actions)), play.stream):
        watch = _Comparing(seen, volatile)
        lab.play(base.play, change=ActionOrder(order), state=False, watch=watch)
        ticks += len(together)
        if watch.turn is not None:
            yield _parted(lab, base, order, watch, ticks, seen, volatile)
            return
    yield lab.fact(OrderOutcome(result="same", ticks=ticks), field="rewards")


def _parted(
    lab: ProbeSession,
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
    lab.play(base.play, state=False, watch=unchanged_rerun)
    if unchanged_rerun.turn is not None and unchanged_rerun.turn <= turn:
        return lab.fact(OrderOutcome(result="noise", ticks=ticks), field="rewards")
    found = first_difference(unchanged_rerun.out, counterfactual.out, volatile)
    found = found or Difference("agents", "", None, None, is_rounding=False)
    result = "rounding"
    p_values: tuple[float, ...] = ()
    if not found.is_rounding:
        verdict = told(lab, FirstDivergence(base.play, order, turn, seen[turn]))
        result, p_values = verdict.result, verdict.p_values
    value = OrderOutcome(
        result, ticks, order, turn, found.part, found.agent, found.one, found.two, p_values
    )
    return lab.fact(
        value, turn=turn - (found.part == "rewards"), agent=found.agent or None, field=found.part
    )


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
