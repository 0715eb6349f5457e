"""Checks of the order of an action dictionary: it changes neither outcome nor draws."""

from __future__ import annotations

from typing import Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, Case, Cases, check
from gamekeeper.checks.facts.play_facts import OrderOutcome
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.statistics.significance import holm

LEVEL = 0.01
"""Chance of calling a mere change of draws an outcome, over all looks together."""
ORDERS: Final[dict[str, str]] = {
    "reversed": "agents[::-1]",
    "rotated": "agents[1:] + agents[:1]",
    "shuffled": "random.Random(turn).sample(agents, len(agents))",
}
"""Every order as an expression over `agents` and `turn`, as a program may have it."""
ORDERED = ("fixed", "rotating", "state", "random")


def _declared(contract: Contract, evidence: ProbeEvidence) -> str | None:
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
    fix="settle the joint action by a rule that is free of order (collect what all do, then "
    "resolve), or go through `self.agents` and declare the order in the contract",
    api="parallel",
    applies=_declared,
)
def outcome_is_free_of_the_actions_order(contract: Contract, evidence: ProbeEvidence) -> Cases:
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
    facts = list(evidence.facts(OrderOutcome))
    corrected = iter(holm([p for fact in facts for p in fact.value.p_values]))
    for fact in facts:
        value = fact.value
        p = min((next(corrected) for _ in value.p_values), default=1.0)
        is_outcome = value.result == "outcome" or p <= LEVEL
        if is_outcome or value.result in ("same", "rounding", "draws"):
            yield Case(
                fact.where,
                not is_outcome,
                "the same whatever the order of the dictionary",
                _seen(fact),
                proof=proof_of_order(value.order),
                confidence=1.0 if value.result == "outcome" else 1.0 - min(p, 0.5),
            )


def _seen(fact: Fact[OrderOutcome]) -> str:
    value = fact.value
    if value.turn is None:
        return f"no difference in {value.ticks} ticks"
    whose = f"{value.part}[{value.agent!r}]" if value.agent else "who is there"
    return f"{whose}: {value.one!r:.120} becomes {value.two!r:.120} ({value.order})"


def proof_of_order(order: str) -> Reproducer:
    """Lines that play the actions in their order and in another, and compare what came of it."""
    return Reproducer(
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
        compares=True,
    )


@check(
    "GK312",
    needs=("order",),
    severity=LOW,
    fix="draw in the order of `self.agents`, not in that of the dictionary that was handed over",
    confidence=0.9,
    api="parallel",
)
def draws_are_free_of_the_actions_order(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Random draws don't come in the order of the action dictionary.

    The game is the same on average, but with one seed two trainers that list agents in another
    order see other episodes, and no rollout can be repeated from seed and actions by name.

    As GK311, which tells a change of draws from a change of the outcome: here are the plays in
    which the two orders differ, something was drawn, and no test tells their distributions apart.

    Bad:
        for agent, action in actions.items():
            if self.rng.random() < 0.9:        # the draw goes to who stands first
                self.move(agent, action)

    Good:
        for agent in self.agents:
            if self.rng.random() < 0.9:
                self.move(agent, actions[agent])
    """
    for fact in evidence.facts(OrderOutcome):
        value = fact.value
        is_drawn = value.result in ("draws", "undecided")
        if is_drawn and min(value.p_values, default=1.0) <= LEVEL:
            continue  # the outcome, which GK311 tells
        if is_drawn or value.result in ("same", "rounding"):
            expected = "the same episode whatever the order of the dictionary"
            seen = f"another one from turn {value.turn} on, with the same chances"
            yield Case(fact.where, not is_drawn, expected, seen, proof_of_order(value.order))
