"""GK304."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._schedule import Crossing, crossings
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

ROUNDS: Final = 5
"""Rounds of everybody in `agents` after which a dead agent has waited for too long."""
LEAST_TURNS: Final = 20
"""Turns of others that a dead agent may wait in any case."""


@check(
    "GK304",
    needs=("rollout",),
    severity=MEDIUM,
    api="aec",
    confidence=0.95,
    mend="select agents that have ended before the live ones: end step() with "
    "`self._deads_step_first()`",
)
def dead_agents_arent_kept_waiting(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A dead agent in `agents` is selected for its None turn before long, and not forgotten.

    Until then its learner doesn't know of the end, nor of its last reward. PettingZoo's own way is
    to let dead agents step first; one that waits for its turn in the order is no fault. Five rounds
    of all agents, and 20 turns at least, are.

    Bad:
    ```python
    live = [a for a in self.agents if not self.terminations[a]]
    self.agent_selection = live[self.turn % len(live)]
    ```
    Good:
    ```python
    self.agent_selection = live[self.turn % len(live)]
    self._deads_step_first()
    ```
    """
    for play in crossings(evidence):
        yield from _waits(play)


def _waits(play: list[Crossing]) -> Iterator[Occasion]:
    since: dict[str, int] = {}
    told: set[str] = set()
    for each in play:
        since = {agent: since.get(agent, each.turn) for agent in each.ended}
        told &= each.ended
        if each.is_dead:
            yield Occasion(each.trace.at(each.turn, each.actor, "agent_selection"), True)
        for agent, turn in since.items():
            most = max(LEAST_TURNS, ROUNDS * len(each.before))
            if each.turn - turn >= most and agent != each.actor and agent not in told:
                told.add(agent)
                yield Occasion(
                    each.trace.at(each.turn, agent, "agent_selection"), False,
                    "selected for its None turn", f"ended {each.turn - turn} turns ago, waiting",
                    proof=_proof(agent, most),
                )  # fmt: skip


def _proof(agent: str, most: int) -> Proof:
    lines = f"""\
env = make()
env.reset(seed=SEED)
waits = 0
for action in ACTIONS:
    ended = [str(a) for a in env.agents if env.terminations[a] or env.truncations[a]]
    is_waiting = {agent!r} in ended and str(env.agent_selection) != {agent!r}
    waits = waits + 1 if is_waiting else 0
    env.last()
    env.step(action)
assert waits < {most}, waits"""
    return Proof(lines, plays=False)
