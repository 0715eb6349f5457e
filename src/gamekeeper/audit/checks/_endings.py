"""Who has ended by a turn's flags, whatever type they are of."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.core.trace import Turn

FLAGS: Final = ("terminated", "truncated")


def ended_in(turn: Turn) -> frozenset[str]:
    """Agents whose flags are up at the turn's start, also where a flag is no bool."""
    odd = {
        agent
        for agent, fields in turn.odd.items()
        if any(_is_up(fields.get(name, {}).get("value")) for name in FLAGS)
    }
    return turn.ended | odd


def is_twofold(turn: Turn) -> bool:
    """A name stands twice in the roster, so that rows don't tell who is who."""
    return len(set(turn.agents)) < len(turn.agents)


def _is_up(flag: Any) -> bool:
    try:
        return bool(flag)
    except Exception:  # an array of flags says nothing
        return False
