"""GK109."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._entries import given
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

AT_RESET = "missing = set(env.agents) - set(infos)\nassert not missing, missing"
IN_STEP = """\
owed = [agent for agent in ACTIONS[-1] if agent in terminations]
missing = [agent for agent in owed if agent not in infos]
assert not missing, missing"""
IN_BOOKS = "missing = set(env.agents) - set(env.infos)\nassert not missing, missing"


@check(
    "GK109",
    needs=("rollout", "surface"),
    severity=MEDIUM,
    mend="give every agent an info, an empty dictionary where there is nothing to say: "
    "`{a: {} for a in agents}`",
)
def every_agent_is_given_an_info(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every agent has its entry in infos: after reset, in every step, and in its last one.

    Wrappers and trainers read `infos[agent]` for masks and statistics, and raise KeyError where an
    entry is missing; an empty dictionary does.

    Bad: `return observations, {}` from reset.

    Good: `return observations, {a: {} for a in self.agents}`.
    """
    if evidence.api == "aec":
        for fact in evidence.facts("surface", "books"):
            for turn, books in enumerate(fact.value):
                agents = books["missing"].get("infos", ())
                yield Occasion(
                    replace(fact.where, turn=turn, field="infos"), not agents,
                    "an entry for every agent in agents", f"none for {', '.join(agents)}",
                    proof=IN_BOOKS,
                )  # fmt: skip
        return
    for trace in evidence["rollout"]:
        for each in given(trace):
            if each.says_nothing:
                continue
            live = each.turn.live if not each.turn.index else each.turn.live & each.before
            owed = live | {agent for agent in each.acted if each.has(agent)}
            owed &= set(each.turn.agents)
            lost = sorted(a for a in owed if "info" in each.missing.get(a, ()))
            yield Occasion(
                trace.at(each.turn, lost[0] if lost else None, "infos"), not lost,
                "an entry for every agent", f"none for {', '.join(lost)}",
                proof=IN_STEP if each.turn.index else AT_RESET,
            )  # fmt: skip
