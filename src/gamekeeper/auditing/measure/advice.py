"""AEC or Parallel: which of the two the game is by itself, with the evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.auditing.measure.influence import seen_in_the_tick
from gamekeeper.checks.probe_evidence import ProbeCounterfactual
from gamekeeper.statistics.significance import wilson

FEWEST: Final = 12
"""Looks; of fewer without a hit the upper bound of the share is above a quarter."""


def advice(
    api: str,
    schedule: Mapping[str, Any] | None,
    order: Mapping[str, Any],
    counterfactuals: Sequence[ProbeCounterfactual],
) -> tuple[str | None, str]:
    """The form that fits what was seen, and why; None where too little was seen.

    Args:
        api: `aec` or `parallel`, which the environment has.
        schedule: as `form.schedule` has it.
        order: `result` and `ticks` of the plays with other orders of the action dictionary.
        counterfactuals: with one replaced action each.
    """
    if api == "parallel":
        return _of_parallel(order)
    if schedule is None or schedule["order"] is None:
        return None, "no two agents acted in one round"
    if schedule["order"] == "other":
        return "aec", f"turns follow no fixed or rotating order in {schedule['rounds']} rounds"
    hits, looks = seen_in_the_tick(counterfactuals)
    share = wilson(hits, looks)
    bounds = f"95 % interval {share.low:.2f} to {share.high:.2f}"
    if hits:
        return "aec", (
            f"what an agent did was observed by a later one of the same round in {hits} of {looks} "
            f"looks with one action replaced ({bounds})"
        )
    if looks < FEWEST:
        return None, f"only {looks} looks at what later agents of a round observe"
    return "parallel", (
        f"in {looks} looks with one action replaced no later agent of the same round observed it "
        f"({bounds}), and turns come in an order that is {schedule['order']}"
    )


def _of_parallel(order: Mapping[str, Any]) -> tuple[str | None, str]:
    result, ticks = order.get("result"), order.get("ticks", 0)
    if result is None:
        return None, "no tick was played with its actions in another order"
    if result == "outcome":
        return "aec", (
            "the order of the action dictionary decides the outcome; in turns the order is part of "
            "the game"
        )
    if result == "draws":
        return "parallel", (
            f"in {ticks} ticks another order of the actions changed only who got which random "
            "draw, not the chances"
        )
    return "parallel", f"in {ticks} ticks another order of the actions changed nothing"
