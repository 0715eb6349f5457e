"""GK301."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK301",
    needs=("rollout",),
    severity=HIGH,
    api="aec",
    mend="after every step name an agent of `agents` in `agent_selection`, also after the None "
    "step of a dead agent",
)
def selection_is_live(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """`agent_selection` names an agent of `agents` as long as there are any, never one removed.

    `last()` and `step()` speak of the agent that is selected: where it isn't in the game any more,
    the loop that everybody writes ends in a KeyError, or one agent's turn is taken for another's.

    Bad:
    ```python
    if self.terminations[agent]:
        self.agents.remove(agent)             # and it stays selected
        return
    ```
    Good:
    ```python
    if self.terminations[agent]:
        self._was_dead_step(action)           # selects who comes next
        return
    ```
    """
    for fact in evidence.facts("rollout", "selected"):
        at = fact.where
        for turn, (name, is_in) in enumerate(fact.value):
            yield Occasion(
                type(at)(at.probe, at.play, turn, None, "agent_selection"), is_in,
                "an agent of `agents`", f"{name!r}, who isn't in `agents`",
                proof="assert not env.agents or env.agent_selection in env.agents, "
                "(env.agent_selection, env.agents)",
            )  # fmt: skip
