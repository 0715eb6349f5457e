"""Recorded and fresh shares of failure that contradict each other. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from gamekeeper.statistics.significance import fisher_exact, holm, p_text

SURE: Final = 0.01
"""A p-value below which recorded and fresh shares differ: runs are often picked by their ends."""


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Recorded and fresh episodes of one scope whose shares of failure differ beyond chance.

    Attributes:
        recorded, fresh: how many episodes failed, and of how many.
        p: of Fisher's exact test, two-sided, corrected for the number of scopes (Holm).
    """

    recorded: tuple[int, int]
    fresh: tuple[int, int]
    p: float

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        both = {"recorded": self.recorded, "fresh": self.fresh}
        counts = {name: {"failed": bad, "episodes": of} for name, (bad, of) in both.items()}
        return {**counts, "p": self.p, "why": str(self)}

    def __str__(self) -> str:
        (bad, of), (fresh_bad, fresh_of) = self.recorded, self.fresh
        return (
            f"{bad} of {of} recorded episodes failed and {fresh_bad} of {fresh_of} fresh ones, "
            f"which chance alone would seldom do (Fisher's exact test, {p_text(self.p)}): what was "
            "played again isn't what was recorded, or the recorded seeds are special; by itself "
            "this is no all-clear"
        )


def contradictions(
    recorded: Mapping[str, tuple[int, int]], fresh: Mapping[str, tuple[int, int]]
) -> dict[str, Contradiction]:
    """Finds the scopes whose recorded and fresh episodes fail with different shares.

    Args:
        recorded: by scope, how many episodes failed, and of how many.
        fresh: the same of fresh episodes with nothing changed.
    """
    scopes = [scope for scope in recorded if scope in fresh]
    corrected = holm([fisher_exact(*recorded[scope], *fresh[scope]) for scope in scopes])
    return {
        scope: Contradiction(recorded[scope], fresh[scope], p)
        for scope, p in zip(scopes, corrected, strict=True)
        if p < SURE
    }
