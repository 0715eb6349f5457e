"""GK105."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._entries import PARTS, given, place
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

FREE: Final = frozenset({"obs", "info"})
"""PettingZoo's own test allows keys for all of them, such as `common`, beside the agents'."""
ROSTER: Final = """\
strangers = set(env.agents) - set(env.possible_agents)
assert not strangers, strangers"""


@check(
    "GK105",
    needs=("rollout", "surface"),
    severity=HIGH,
    mend="list in possible_agents every agent that may ever join, and speak of agents only in the "
    "dictionaries; where names can't be known leave possible_agents out",
)
def only_possible_agents_take_part(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Nobody stands in `agents`, is paid or ends who isn't one of possible_agents.

    A trainer has no policy, no space and no column for a name that it never heard of: it crashes
    in the middle of an episode, or drops the agent. `__all__` is another library's habit.

    Bad: `self.agents.append(f"guest_{self.count}")`, while possible_agents lists three hosts.

    Good: `possible_agents` lists as many guests as can ever come, and `agents` those who are there.
    """
    possible = set(evidence.agents)
    for fact in evidence.facts("surface", "possible_agents"):
        stages = [fact.value["before"], *fact.value["turns"], fact.value["again"]]
        possible.update(name for names in stages for name in names or ())
    if not possible:
        return
    for fact in evidence.facts("surface", "agents"):
        for turn, names in enumerate(fact.value["turns"]):
            strangers = sorted(set(names or ()) - possible)
            yield Occasion(
                replace(fact.where, turn=turn), not strangers,
                sorted(possible), f"also {', '.join(strangers)}", proof=ROSTER,
            )  # fmt: skip
    if evidence.api == "parallel":
        yield from _strangers_in_dictionaries(evidence, possible)


def _strangers_in_dictionaries(evidence: Gathered, possible: set[str]) -> Iterator[Occasion]:
    for trace in evidence["rollout"]:
        for each in given(trace):
            if not each.turn.index:
                continue
            strangers = [a for a in each.turn.agents if not _is_known(a, possible)]
            for agent in strangers:
                for part in sorted(each.has(agent) - FREE):
                    yield Occasion(
                        place(trace, each.turn, agent, part), False,
                        "entries of agents only", f"an entry of {agent!r}", proof=_proof(part),
                    )  # fmt: skip
            if not strangers:
                yield Occasion(trace.at(each.turn, None, "agents"), True)


def _is_known(agent: str, possible: set[str]) -> bool:
    """Possible, or no text: spelt in another way where agents were asked for, or told apart."""
    return agent in possible or agent.startswith(("{", "[")) or agent.rstrip("'") in possible


def _proof(part: str) -> str:
    book = PARTS[part]
    return f"strangers = set({book}) - set(env.possible_agents)\nassert not strangers, strangers"
