"""GK205."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK205",
    needs=("spaces",),
    severity=LOW,
    mend="let the method return what the dictionary holds, or drop the dictionary",
)
def space_dictionaries_agree(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The dictionaries `observation_spaces` and `action_spaces` say what the methods say.

    Older readers take a space from the dictionary, newer ones from the method.

    Bad:

        self.action_spaces = {a: Discrete(4) for a in self.possible_agents}
        def action_space(self, agent): return self._spaces[agent]          # Discrete(5)

    Good:

        def action_space(self, agent): return self.action_spaces[agent]
    """
    for fact in evidence.facts("spaces", "attribute"):
        value, name = fact.value, fact.where.field
        yield Occasion(
            fact.where, bool(value["is_same"]), f"{value['method']}, as the method says",
            value["dictionary"],
            proof=(
                f"for agent, space in env.{name}.items():\n"
                f"    assert space == env.{name.removesuffix('s')}(agent), (agent, space)"
            ),
        )  # fmt: skip
