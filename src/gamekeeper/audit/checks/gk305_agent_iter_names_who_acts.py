"""GK305."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK305",
    needs=("lifecycle",),
    severity=MEDIUM,
    api="aec",
    mend="leave `agent_iter` as `AECEnv` has it: it yields `agent_selection` until `agents` is "
    "empty, `max_iter` times at most",
)
def agent_iter_names_who_acts(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """`agent_iter` names the agent that is to act, as often as it is asked to.

    Everybody plays with `for agent in env.agent_iter():`. An iterator of one's own that runs
    through the agents in its own order gives one agent's observation to another's policy.

    Bad:
    ```python
    def agent_iter(self, max_iter=2**63):
        return iter(self.agents)
    ```
    Good:
    ```python
    for agent in env.agent_iter():            # AECEnv's own
        observation, reward, terminated, truncated, info = env.last()
    ```
    """
    for fact in evidence.facts("lifecycle", "iterated"):
        seen = fact.value
        is_long = len(seen["named"]) == seen["asked"]
        yield Occasion(
            fact.where, is_long and seen["named"] == seen["selected"],
            f"{seen['asked']} turns, of {seen['selected']}", f"{seen['named']}", proof=fact.proof,
        )  # fmt: skip
