"""Cut-offs: the turn at which recorded episodes were truncated, and the argument that says so."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from gamekeeper.episodes.outcome import Outcome

HORIZONS: Final = ("max_cycles", "max_steps", "episode_limit", "horizon", "max_episode_steps")
"""Names of the argument that cuts an episode off, in several libraries."""


def truncating_turn(outcomes: Iterable[Outcome]) -> int | None:
    """The one number of turns after which episodes were truncated; None: none was, or several.

    An episode counts where all of its agents were truncated.
    """
    turns = {
        each.turns
        for each in outcomes
        if each.flags and all(flag == "truncated" for flag in each.flags.values())
    }
    return turns.pop() if len(turns) == 1 else None


def cutting_arguments(given: Mapping[str, Any], turn: int | None, agents: int) -> dict[str, int]:
    """The arguments whose value is the truncating turn, counted in turns or in rounds of agents."""
    if turn is None:
        return {}
    found = {
        name: value
        for name, value in given.items()
        if isinstance(value, int) and not isinstance(value, bool) and value > 0
    }
    return {name: value for name, value in found.items() if _cuts(value, turn, max(agents, 1))}


def _cuts(value: int, turn: int, agents: int) -> bool:
    """A round is a turn of each agent; the last one may be broken off or followed by farewells."""
    return value == turn or (agents > 1 and 0 <= turn - value * agents <= agents)
