"""Rosters of plays beside their traces."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import Trace


def plays_with_rosters(evidence: Gathered) -> Iterator[tuple[Trace, list[list[str]]]]:
    """Each play of the rollouts, with the roster at the start of each of its turns."""
    for look in evidence.looks.get("rollout", ()):
        rosters = next((fact.value for fact in look.facts if fact.name == "agents"), None)
        if look.traces and rosters is not None:
            yield look.traces[0], rosters
