"""GK102."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.fact import Fact
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof
from gamekeeper.core.where import Where

IN_PLAY = Proof("""\
named = list(make().possible_agents)
assert list(env.possible_agents) == named, (list(env.possible_agents), named)""")
AFTER_RESET = Proof("""\
env.reset(seed=SEED)
named = list(make().possible_agents)
assert list(env.possible_agents) == named, (list(env.possible_agents), named)""")
OF_ANOTHER = Proof(
    """\
one, other = list(make().possible_agents), list(make().possible_agents)
assert one == other, (one, other)""",
    plays=False,
)


@check(
    "GK102",
    needs=("surface",),
    severity=HIGH,
    mend="build possible_agents once in the constructor and never touch it again; in reset take a "
    "copy: `self.agents = self.possible_agents[:]`",
)
def possible_agents_never_change(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """possible_agents stays the same list of names for good, whoever leaves `agents`.

    Where `agents` is the same list as `possible_agents`, or shares it between instances, an agent
    that is removed is gone from every later episode, and readers who built a policy for each
    possible agent play another game than the first.

    Bad: `self.agents = self.possible_agents`, then `self.agents.remove(agent)`.

    Good: `self.agents = self.possible_agents[:]`.
    """
    first = list(evidence.agents)  # named before anything was played
    for fact in evidence.facts("surface", "possible_agents"):
        before, turns = fact.value["before"], fact.value["turns"]
        named = before or next((names for names in turns if names), None)
        if named is None:
            continue
        if first and before:
            is_fresh = fact.value["fresh"]
            whose = "of another instance" if is_fresh else "since the audit began"
            where = replace(fact.where, turn=0, field=f"possible_agents {whose}")
            yield _look(
                where, list(dict.fromkeys(before)), first, OF_ANOTHER if is_fresh else IN_PLAY
            )
        yield from _in_play(fact, named, turns)


def _in_play(fact: Fact, named: list[str], turns: list[Any]) -> Iterator[Occasion]:
    for turn, names in enumerate(turns):
        yield _look(replace(fact.where, turn=turn), names, named, IN_PLAY)
        if names != named:
            return
    if turns and fact.value["again"] is not None:
        where = replace(fact.where, turn=len(turns) - 1, field="possible_agents after a reset")
        yield _look(where, fact.value["again"], named, AFTER_RESET)


def _look(where: Where, names: Any, named: list[str], proof: Proof) -> Occasion:
    return Occasion(where, names == named, named, names, proof=proof)
