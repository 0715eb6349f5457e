"""GK902."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = (
    "names = [str(agent) for agent in dict.fromkeys([*env.possible_agents, *env.agents])]\n"
    "assert len(set(names)) == len(names), names\nassert all(names), names"
)


@check(
    "GK902",
    needs=("evidence",),
    severity=MEDIUM,
    mend="give every agent a name of its own, as text",
)
def agents_can_be_told_apart_as_text(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Agents can be told apart as text: no two are written alike, and none is empty.

    Tables, files and most trainers know agents by their text; the int 1 and the text "1" become
    one. Agents that aren't texts are fine as long as their texts differ.

    Bad:
        self.possible_agents = [1, "1"]

    Good:
        self.possible_agents = ["player_1", "judge_1"]
    """
    for fact in evidence.facts("evidence", "names"):
        counted = Counter(text for text, _ in fact.value)
        alike = [text for text, count in counted.items() if count > 1 or not text]
        seen = alike or list(counted)
        yield Occasion(fact.where, not alike, "texts that differ", seen, proof=PROOF)
