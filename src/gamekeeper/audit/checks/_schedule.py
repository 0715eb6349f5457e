"""Who stood in `agents` before and after each crossing of an AEC play, and who crossed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gamekeeper.audit.checks._endings import ended_in
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import Trace

BEFORE_AND_AFTER = """\
env = make()
env.reset(seed=SEED)
for action in ACTIONS:
    before, actor = list(env.agents), env.agent_selection
    ended = env.terminations[actor] or env.truncations[actor]
    env.last()
    env.step(action)
"""
"""Plays, and leaves what was before the last step in `before`, `actor` and `ended`."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """One step of an AEC play.

    Attributes:
        trace: of which play.
        turn: the one that it ends.
        actor: whose step it was.
        is_dead: the actor had ended before it.
        before: `agents` before the step.
        after: `agents` after it.
        ended: agents whose flags were up before it, and that haven't left.
    """

    trace: Trace
    turn: int
    actor: str
    is_dead: bool
    before: Sequence[str]
    after: Sequence[str]
    ended: frozenset[str]


def crossings(evidence: Gathered) -> Iterator[list[Crossing]]:
    """The steps of each play that have been made."""
    rosters = [fact.value for fact in evidence.facts("rollout", "agents")]
    for trace, agents in zip(evidence["rollout"], rosters, strict=False):
        yield list(_crossings(trace, agents))


def _crossings(trace: Trace, agents: Sequence[Sequence[str]]) -> Iterator[Crossing]:
    ended: frozenset[str] = frozenset()
    for turn in trace.turns:
        if turn.index + 1 >= len(agents) or not turn.order:
            return
        before, after = agents[turn.index], agents[turn.index + 1]
        actor = turn.order[0]
        # an agent that is back under its name begins anew
        flagged = ended_in(turn)
        ended = (ended | flagged) & frozenset(before)
        yield Crossing(trace, turn.index, actor, actor in flagged, before, after, ended)
