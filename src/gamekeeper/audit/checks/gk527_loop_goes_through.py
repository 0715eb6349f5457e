"""GK527."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._endings import ended_in
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered, Look
from gamekeeper.core.trace import Trace

EXPECTED: Final = "`last()` and None steps that raise nothing"
SHOWN: Final = {"last": "env.last()", "step": "# nothing more: the None step above raised"}


@check(
    "GK527",
    needs=("rollout",),
    severity=HIGH,
    api="aec",
    mend="let `observe` answer for every agent in `agents`, also for one that has ended, and hand "
    "the None of a dead agent to `self._was_dead_step(action)`",
)
def the_loop_goes_through(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The loop over agents goes through: `last()` and the None steps of the dead raise nothing.

    `for agent in env.agent_iter()` asks whoever is in turn for `last()`, an agent that has just
    ended too: that is where its learner reads the last reward. What raises there ends every
    training, and mostly late, once somebody has ended. Judged where the agent in turn is in
    `agents`; a step of the living that raises is another promise.

    Bad:
    ```python
    def observe(self, agent):
        return self.views[agent]              # whose entry went with its end
    ```
    Good:
    ```python
    def observe(self, agent):
        return self.views.get(agent, self.blank)
    ```
    """
    for look in evidence.looks.get("rollout", ()):
        facts = {fact.name: fact for fact in look.facts}
        raised, selected = facts.get("raised"), facts["selected"].value
        if raised is None:
            yield Occasion(_end(look), True)
        elif selected and selected[-1][1] and _is_of_the_loop(look, raised.value):
            agent = selected[-1][0]
            yield Occasion(
                _trace(look).at(raised.where.turn, agent, "raised"), False, EXPECTED,
                f"{raised.value['kind']}: {raised.value['text']}",
                proof=SHOWN[raised.value["call"]],
            )  # fmt: skip


def _trace(look: Look) -> Trace:
    return look.traces[0]


def _end(look: Look) -> Any:
    return _trace(look).at(None, None, "raised")


def _is_of_the_loop(look: Look, raised: dict[str, Any]) -> bool:
    """Whether `last()` raised, or the None step of one that had ended."""
    if raised["call"] == "last":
        return True
    turns = [turn for turn in _trace(look).turns if turn.raised and turn.order]
    return raised["call"] == "step" and any(
        agent in ended_in(turn) and turn.actions.get(agent) is None
        for turn in turns
        for agent in turn.order
    )
