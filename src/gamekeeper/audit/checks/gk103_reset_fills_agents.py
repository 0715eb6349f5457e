"""GK103."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

FILLED = "assert list(env.agents), 'nobody is there after the reset'"
RESTORED = """\
env.reset(seed=SEED)
fresh = make()
fresh.reset(seed=SEED)
assert set(env.agents) == set(fresh.agents), (list(env.agents), list(fresh.agents))"""


@check(
    "GK103",
    needs=("surface",),
    severity=HIGH,
    mend="fill `agents` anew in every reset, from scratch: `self.agents = self.possible_agents[:]`",
)
def every_reset_fills_the_roster(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every reset fills `agents`: somebody is there, and nobody of the last episode is missing.

    A reset that leaves out agents which ended, or keeps what the last episode left, makes each
    episode smaller or larger than the one before; loops over `agents` do nothing at all where it
    stays empty.

    Bad: `reset` sets up the board, but `self.agents` was filled by the constructor only.

    Good: `self.agents = self.possible_agents[:]` in `reset`.
    """
    shrunk = {
        fact.where.play
        for fact in evidence.facts("surface", "possible_agents")
        if fact.value["again"] != fact.value["before"]
    }
    for fact in evidence.facts("surface", "agents"):
        first, turns, again = fact.value["first"], fact.value["turns"], fact.value["again"]
        if not turns or turns[0] is None:
            continue
        yield Occasion(
            replace(fact.where, turn=0), bool(turns[0]), "agents that can act", "nobody",
            proof=FILLED,
        )  # fmt: skip
        # where two resets in a row already differ the play isn't to blame, and where the possible
        # agents have changed that is it
        is_known = first is not None and sorted(first) == sorted(turns[0])
        if turns[0] and is_known and fact.where.play not in shrunk:
            yield Occasion(
                replace(fact.where, turn=len(turns) - 1, field="agents after the next reset"),
                again is None or set(again) == set(first), first, again, proof=RESTORED,
            )  # fmt: skip
            if fact.value["midway"] is not None:
                turn, midway = fact.value["midway"]
                yield Occasion(
                    replace(fact.where, turn=turn, field="agents after a reset in mid-episode"),
                    midway is None or set(midway) == set(first), first, midway, proof=RESTORED,
                )  # fmt: skip
