"""Influence of each agent's action on observations, rewards and endings, with its lag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from gamekeeper.checks.effects import effects, influence_rows, later_looks
from gamekeeper.checks.probe_evidence import ProbeCounterfactual


def influence(counterfactuals: Sequence[ProbeCounterfactual]) -> list[dict[str, Any]]:
    """The share of replaced actions that changed something, by pair, place and lag.

    With Wilson's 95 % interval. A lag counts turns: 0 is the step itself, and what it was shown
    next.
    """
    looks: Counter[tuple[str, str, str, int]] = Counter()
    hits: Counter[tuple[str, str, str, int]] = Counter()
    for counterfactual in counterfactuals:
        for effect in effects(counterfactual):
            key = (effect.source, effect.target, str(effect.on), effect.lag)
            looks[key] += 1
            hits[key] += effect.is_changed
    return influence_rows(looks, hits)


def seen_in_the_tick(counterfactuals: Sequence[ProbeCounterfactual]) -> tuple[int, int]:
    """Times that a later agent of a tick observed an earlier action of it, and its chances."""
    found = [
        is_seen for counterfactual in counterfactuals for _, is_seen in later_looks(counterfactual)
    ]
    return sum(found), len(found)
