"""GK107."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._entries import PARTS, Given, given, place
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK107",
    needs=("rollout", "surface"),
    severity=HIGH,
    mend="give every agent in `agents` its entry in each dictionary, also where nothing happened "
    "to it: build them over `self.agents`",
)
def every_live_agent_is_told_everything(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Every agent in `agents` is given an observation, a reward and both flags, at every step.

    An agent without an observation can't choose an action, and one without a reward or a flag
    makes learners raise KeyError or shift their batches by a step.

    Bad: `observations = {a: see(a) for a in moved}`: who waited is told nothing.

    Good: `observations = {a: see(a) for a in self.agents}`.
    """
    if evidence.api == "aec":
        yield from _in_books(evidence)
        return
    for trace in evidence["rollout"]:
        for each in given(trace):
            if each.says_nothing:
                continue
            bad = [(a, p) for a in sorted(each.missing) for p in _owed(each, a)]
            for agent, part in bad:
                yield Occasion(
                    place(trace, each.turn, agent, part), False,
                    "an entry, as the agent is live", "no entry", proof=_proof(PARTS[part]),
                )  # fmt: skip
            if not bad:
                yield Occasion(trace.at(each.turn, None, "agents"), True)


def _owed(each: Given, agent: str) -> list[str]:
    """What a live agent should have been told; one that has just joined is only owed a view."""
    if agent not in each.turn.live:
        return []
    has_joined = each.turn.index and agent not in each.before
    owed = {"obs"} if has_joined else each.all_parts - {"info"}
    return sorted(each.missing[agent] & owed)


def _in_books(evidence: Gathered) -> Iterator[Occasion]:
    for fact in evidence.facts("surface", "books"):
        for turn, books in enumerate(fact.value):
            missing = {name: a for name, a in books["missing"].items() if name != "infos"}
            for name, agents in missing.items():
                yield Occasion(
                    replace(fact.where, turn=turn, agent=agents[0], field=name), False,
                    "an entry for every agent in agents", f"none for {', '.join(agents)}",
                    proof=_proof(f"env.{name}"),
                )  # fmt: skip
            if not missing:
                yield Occasion(replace(fact.where, turn=turn, field="agents"), True)


def _proof(book: str) -> str:
    return f"missing = set(env.agents) - set({book})\nassert not missing, missing"
