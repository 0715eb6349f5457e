"""How often a play moved, as far as its agents could see."""

from __future__ import annotations

from gamekeeper.core.canon import to_json
from gamekeeper.core.trace import Trace


def moves(trace: Trace) -> int:
    """The number of turns at which some agent observed something else than it last did."""
    seen: dict[str, str] = {}
    count = 0
    for turn in trace.turns:
        now = {agent: to_json(value) for agent, value in turn.observations.items()}
        count += any(seen.get(agent, text) != text for agent, text in now.items())
        seen.update(now)
    return count
