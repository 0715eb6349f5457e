"""How many ticks a play has seen, whatever its API."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from gamekeeper.audit.checks._endings import ended_in
from gamekeeper.core.trace import Trace, Turn


def ticks_before(trace: Trace, api: str) -> Iterator[tuple[Turn, int]]:
    """Each turn with the ticks that were over at its start.

    Parallel: a tick is a step. AEC: a tick is over when nobody has more turns of its own in it, so
    as many are over, or under way, as the agent that has acted most has acted.
    """
    acted: Counter[str] = Counter()
    most = 0
    for turn in trace.turns:
        yield turn, turn.index if api == "parallel" else most
        ended = ended_in(turn)
        for agent in turn.order:
            if agent not in ended:
                acted[agent] += 1
                most = max(most, acted[agent])
