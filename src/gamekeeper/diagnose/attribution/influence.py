"""Whose action changes whose observation, reward or ending, how often and how much later. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, Final

from gamekeeper.core.stats import wilson

SHOWN_AGENTS: Final = 6
"""In larger teams only what changed at least once is listed."""


def influence(scans: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The share of replaced actions that changed something, with Wilson's 95 % interval.

    Turns from which on an unchanged rerun differs by itself are no looks, so what is counted is
    beyond the sham.
    """
    looks: Counter[tuple[str, str, str, int]] = Counter()
    hits: Counter[tuple[str, str, str, int]] = Counter()
    for each in scans:
        for source, target, on, lag, changed, looked in each["influence"]:
            looks[source, target, on, lag] += looked
            hits[source, target, on, lag] += changed
    is_small = len({source for source, *_ in looks}) <= SHOWN_AGENTS
    rows = []
    for key in sorted(looks):
        if hits[key] or is_small:
            share = wilson(hits[key], looks[key])
            rows.append({
                "from": key[0], "to": key[1], "on": key[2], "lag": key[3], "p": share.p,
                "low": share.low, "high": share.high, "n": share.n,
            })  # fmt: skip
    return rows
