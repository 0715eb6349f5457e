"""GK311."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.fact import Fact
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof
from gamekeeper.core.stats import holm
from gamekeeper.run.changes.action_order import ORDERS

LEVEL = 0.01
"""Chance of calling a mere change of draws an outcome, over all looks together."""
ORDERED = ("fixed", "rotating", "state", "random")


def _declared(contract: Contract, evidence: Gathered) -> str | None:
    schedule = contract.schedule
    if schedule.conflicts in ("ordered", "priority"):
        return f"the contract declares conflicts as {schedule.conflicts!r}"
    if schedule.order in ORDERED:
        return f"the contract declares that agents act in an order ({schedule.order})"
    return None


@check(
    "GK311",
    needs=("order",),
    severity=HIGH,
    mend="settle the joint action by a rule that is free of order (collect what all do, then "
    "resolve), or go through `self.agents` and declare the order in the contract",
    api="parallel",
    applies=_declared,
)
def outcome_is_free_of_the_actions_order(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """The outcome of a joint action doesn't depend on the order of the action dictionary.

    A dictionary has no order to promise: trainers take agents from lists, sets, sorted names. Where
    the first in it wins a conflict, they train another game than the one that is described.

    Whole episodes are played again with the dictionary reversed and shuffled, against a rerun with
    nothing changed. Where a difference shows and no generator has moved, it is the outcome. Where
    something was drawn, both orders get fresh random futures from the same state (20 each) and a
    permutation test over all numbers of the outcome (max-T, 4,999 permutations; at other states a
    sign-flip test) says whether they have one distribution, corrected by Holm over all looks: the
    chance that mere draws are called an outcome is at most 1 %.

    Bad:

        for agent, action in actions.items():  # who stands first takes the cell
            if target(agent, action) not in taken:
                self.cells[agent] = target(agent, action)

    Good:

        wanted = {agent: target(agent, actions[agent]) for agent in self.agents}
        for agent, cell in wanted.items():     # two that want one cell both stay
            if [*wanted.values()].count(cell) == 1:
                self.cells[agent] = cell
    """
    facts = list(evidence.facts("order", "order"))
    corrected = iter(holm([p for fact in facts for p in fact.value.get("p_values", ())]))
    for fact in facts:
        value = fact.value
        p = min((next(corrected) for _ in value.get("p_values", ())), default=1.0)
        is_outcome = value["result"] == "outcome" or p <= LEVEL
        if is_outcome or value["result"] in ("same", "rounding", "draws"):
            yield Occasion(
                fact.where, not is_outcome,
                "the same whatever the order of the dictionary", _seen(fact),
                proof=proof_of_order(value.get("order", "reversed")),
                confidence=1.0 if value["result"] == "outcome" else 1.0 - min(p, 0.5),
            )  # fmt: skip


def _seen(fact: Fact) -> str:
    value = fact.value
    if "one" not in value:
        return f"no difference in {value['ticks']} ticks"
    whose = f"{value['part']}[{value['agent']!r}]" if value["agent"] else "who is there"
    return f"{whose}: {value['one']!r:.120} becomes {value['two']!r:.120} ({value['order']})"


def proof_of_order(order: str) -> Proof:
    """Lines that play the actions in their order and in another, and compare what came of it."""
    return Proof(
        "def outcomes(order):\n"
        "    env, found = make(), []\n"
        "    env.reset(seed=SEED)\n"
        "    for turn, actions in enumerate(ACTIONS):\n"
        "        agents = order(list(actions), turn)\n"
        "        found.append(copy.deepcopy(env.step({a: actions[a] for a in agents})))\n"
        "    return found\n"
        "\n"
        "one = outcomes(lambda agents, turn: agents)\n"
        f"other = outcomes(lambda agents, turn: {ORDERS[order]})\n"
        "np.testing.assert_equal(other, one)",
        plays=False,
        imports=("copy", "random"),
    )
