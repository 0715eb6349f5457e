"""GK216."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._observations import is_of_mask
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK216",
    needs=("spaces",),
    severity=MEDIUM,
    mend="let observe(agent) give an observation of the agent's space at any turn",
    api="aec",
)
def others_can_be_observed(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """`observe` gives an observation of its space for every live agent, also one not in turn.

    Conversions to Parallel, centralised critics and recorders observe all agents at every turn.

    Bad:

        def observe(self, agent):
            return self._view if agent == self.agent_selection else None

    Good:

        def observe(self, agent):
            return self._view_of(agent)
    """
    for fact in evidence.facts("spaces", "observed"):
        value, agent = fact.value, str(fact.where.agent)
        wrong: list[Any] = [each for each in value["misfits"] if not is_of_mask(each[0], each[1])]
        ok = value["failed"] is None and not wrong
        expected, seen, test = "an observation of its space", value["failed"], "True"
        if wrong:
            _, path, what, seen, test = wrong[0]
            expected = f"{what} at observation{path}" if path else what
        yield Occasion(
            fact.where, ok, expected, seen,
            proof=(
                f"agent = next(a for a in env.agents if str(a) == {agent!r})\n"
                "value, space = env.observe(agent), env.observation_space(agent)\n"
                f"assert {test}, value"
            ),
        )  # fmt: skip
