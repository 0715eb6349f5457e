"""Whose action changes whose observation, reward or ending, how often and how much later."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, Final

from gamekeeper.audit.effects import effects
from gamekeeper.audit.rounds import ticks
from gamekeeper.core.gathered import Twin
from gamekeeper.core.stats import wilson

SHOWN_AGENTS: Final = 6
"""In larger rosters only what changed at least once is listed."""


def influence(twins: Sequence[Twin]) -> list[dict[str, Any]]:
    """The share of replaced actions that changed something, by pair, place and lag.

    With Wilson's 95 % interval. A lag counts turns: 0 is the crossing itself, and what it was shown
    next.
    """
    looks: Counter[tuple[str, str, str, int]] = Counter()
    hits: Counter[tuple[str, str, str, int]] = Counter()
    for twin in twins:
        for effect in effects(twin):
            key = (effect.source, effect.target, str(effect.on), effect.lag)
            looks[key] += 1
            hits[key] += effect.is_changed
    is_small = len({source for source, *_ in looks}) <= SHOWN_AGENTS
    rows = []
    for key in sorted(looks):
        if hits[key] or is_small:
            share = wilson(hits[key], looks[key])
            rows.append(
                {
                    "from": key[0], "to": key[1], "on": key[2], "lag": key[3],
                    "p": round(share.p, 4), "low": round(share.low, 4),
                    "high": round(share.high, 4), "n": share.n,
                }
            )  # fmt: skip
    return rows


def seen_in_the_tick(twins: Sequence[Twin]) -> tuple[int, int]:
    """How often a later agent of the same tick observed what was done before it, and its looks."""
    found = [is_seen for twin in twins for _, is_seen in later_looks(twin)]
    return sum(found), len(found)


def later_looks(twin: Twin) -> Iterator[tuple[tuple[int, str], bool]]:
    """Turn and agent of those who act later in the tick, and whether they observe the change."""
    start = int(twin.change["turn"])
    tick = next((each for each in ticks(twin.base) if start in each), range(0))
    movers = {turn.index: turn.order for turn in twin.base.turns if turn.index in tick}
    for effect in effects(twin):
        turn = start + 1 + effect.lag
        if effect.on == "observation" and effect.target in movers.get(turn, ()):
            yield (turn, effect.target), effect.is_changed
