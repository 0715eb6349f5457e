"""GK106."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._entries import PARTS, given, place
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

ACCOUNTS: Final = frozenset({"received", "terminated", "truncated"})
BOOKS: Final = ("rewards", "terminations", "truncations", "infos")


@check(
    "GK106",
    needs=("rollout", "surface"),
    severity=MEDIUM,
    mend="build the dictionaries over those who acted in this step (and who joined in it), not "
    "over possible_agents",
)
def accounts_are_kept_of_the_living_only(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Who isn't in the game, as it has left, isn't in rewards, terminations or truncations either.

    Readers walk over the dictionaries: they store steps that the dead never made, count its end
    once a step, or add up what nobody was paid.

    Bad: `rewards = {a: 0.0 for a in self.possible_agents}` in every step.

    Good: `rewards = {a: 0.0 for a in self.agents}`, taken before anybody is removed.
    """
    if evidence.api == "aec":
        yield from _in_books(evidence)
        return
    for trace in evidence["rollout"]:
        ever: set[str] = set()
        for each in given(trace):
            ever |= each.turn.live
            gone = {a for a in each.turn.agents if a in ever or a in evidence.agents}
            gone -= each.turn.live | each.before | each.acted
            gone -= each.turn.ended - ever  # they joined, and ended in the same step
            bad = [(a, part) for a in sorted(gone) for part in sorted(each.has(a) & ACCOUNTS)]
            for agent, part in bad:
                yield Occasion(
                    place(trace, each.turn, agent, part), False, "no entry: it isn't in the game",
                    f"an entry in {PARTS[part]}", proof=_proof(part),
                )  # fmt: skip
            if not bad:
                yield Occasion(trace.at(each.turn, None, "agents"), True)


def _in_books(evidence: Gathered) -> Iterator[Occasion]:
    for fact in evidence.facts("surface", "books"):
        for turn, books in enumerate(fact.value):
            found = {name: books["strangers"].get(name) for name in BOOKS}
            for name, agents in found.items():
                if agents:
                    yield Occasion(
                        replace(fact.where, turn=turn, agent=agents[0], field=name), False,
                        "entries of those in agents", f"also of {', '.join(agents)}",
                        proof=f"gone = set(env.{name}) - set(env.agents)\nassert not gone, gone",
                    )  # fmt: skip
            if not any(found.values()):
                yield Occasion(replace(fact.where, turn=turn, field="agents"), True)


def _proof(part: str) -> str:
    return f"gone = set({PARTS[part]}) - set(env.agents) - set(ACTIONS[-1])\nassert not gone, gone"
