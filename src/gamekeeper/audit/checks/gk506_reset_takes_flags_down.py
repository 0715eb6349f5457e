"""GK506."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

FRESH = """\
flagged = [a for a in env.agents if env.terminations[a] or env.truncations[a]]
assert not flagged, flagged"""
AFTER = f"env.reset(seed=SEED)\n{FRESH}"


@check(
    "GK506",
    needs=("surface",),
    severity=HIGH,
    mend="in reset: `self.terminations = dict.fromkeys(self.agents, False)`, and the same for "
    "truncations",
    api="aec",
)
def a_reset_takes_the_flags_down(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """After a reset nobody is terminated or truncated, whatever the last episode came to.

    An episode whose agents have ended before it begins is over at once, and the loop around it
    counts an empty one.

    Bad: flags are set in the constructor and by `step` only.

    Good: `self.terminations = dict.fromkeys(self.agents, False)` in `reset`.
    """
    rosters = {fact.where.play: fact.value for fact in evidence.facts("surface", "agents")}
    for fact in evidence.facts("surface", "flagged"):
        first, second, third = fact.value
        turns = len(rosters[fact.where.play]["turns"])
        if not turns:
            continue
        flagged = first or second
        yield Occasion(
            replace(fact.where, turn=0), not flagged, "no flags up", f"up: {', '.join(flagged)}",
            proof=FRESH,
        )  # fmt: skip
        if not flagged and rosters[fact.where.play]["again"] is not None:
            yield Occasion(
                replace(fact.where, turn=turns - 1, field="terminations after the next reset"),
                not third, "no flags up", f"up: {', '.join(third)}", proof=AFTER,
            )  # fmt: skip
