"""GK331."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.literal import literal
from gamekeeper.audit.measure.influence import later_looks
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


def _declared(contract: Contract, evidence: Gathered) -> str | None:
    schedule = contract.schedule
    if schedule.order == "none" or schedule.observe == "after tick":
        return None
    return "the contract doesn't declare that agents act at once (schedule.order, .observe)"


@check(
    "GK331",
    needs=("influence",),
    severity=HIGH,
    mend="let observe() show what was at the start of the tick until all have acted, or declare "
    'schedule.observe = "after turn"',
    api="aec",
    applies=_declared,
)
def moves_of_the_tick_stay_unseen(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Who acts later in a simultaneous tick doesn't observe what was done earlier in it.

    An environment that plays a simultaneous game in turns must hide the moves of the tick: else the
    last to act answers them, and it is another game, won by whoever is asked last.

    By intervention: one agent's action is replaced, and what later agents of the same tick and
    stage observe is compared.

    Bad:

        def step(self, action):
            self.hands[self.agent_selection] = action   # observe() shows self.hands

    Good:

        def step(self, action):
            self.chosen[self.agent_selection] = action
            if self.is_last():
                self.hands = dict(self.chosen)
    """
    for twin in evidence.twins("influence"):
        start, agent = int(twin.change["turn"]), str(twin.change["agent"])
        for (turn, other), is_seen in later_looks(twin):
            if _stage(contract, agent) == _stage(contract, other):
                yield Occasion(
                    twin.base.at(turn, other, "observations"), not is_seen,
                    f"the same observation whatever {agent!r} did at turn {start} of this tick",
                    f"another one where {agent!r} does {literal(twin.change['action'])}",
                    proof=_proof(start, turn, twin.change["action"]),
                )  # fmt: skip


def _stage(contract: Contract, agent: str) -> int | None:
    """The place of the agent's stage; None where no stages are declared."""
    role = contract.role_of(agent)
    stages = contract.schedule.stages or ()
    return next((place for place, stage in enumerate(stages) if role in stage), None)


def _proof(start: int, turn: int, action: Any) -> Proof:
    return Proof(
        "def seen(actions):\n"
        "    env = make()\n"
        "    env.reset(seed=SEED)\n"
        "    for action in actions:\n"
        "        env.last()\n"
        "        env.step(action)\n"
        "    return env.last()[0]\n"
        "\n"
        "other = list(ACTIONS)\n"
        f"other[{start}] = {literal(action)}\n"
        f"np.testing.assert_equal(seen(other[:{turn}]), seen(ACTIONS[:{turn}]))",
        plays=False,
    )
