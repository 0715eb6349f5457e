"""GK222."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._illegal import proof
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK222",
    needs=("illegal",),
    severity=MEDIUM,
    mend="refuse an illegal action before anything is changed, and let reset() start from nothing",
)
def illegal_actions_break_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An illegal action is taken or refused, and after it a reset starts a playable episode.

    An environment may raise whatever it likes, or coerce the action. But a process that dies, and
    an instance that can't be reset any more, take a whole training with them.

    Bad:

        self.is_stepping = True
        position = MOVES[action]               # raises; is_stepping stays, and reset() refuses

    Good:

        if not self.action_space(agent).contains(action):
            raise ValueError(f"{agent}: {action!r} is no action")
    """
    for fact in evidence.facts("illegal", "died"):
        yield Occasion(fact.where, False, "an exception at most", f"the process {fact.value}")
    for fact in evidence.facts("illegal", "illegal"):
        value: Mapping[str, Any] = fact.value
        yield Occasion(
            fact.where, value["again"] is None, "a reset that starts a playable episode",
            f"after the action ({value['case']}) {value['again']}",
            proof=proof(evidence.api, fact.where.turn, value, AGAIN),
        )  # fmt: skip


AGAIN = "env.reset(seed=SEED)\nfor actions in ACTIONS:\n    env.step(actions)"
