"""GK421."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.literal import literal
from gamekeeper.core.contract import Contract
from gamekeeper.core.fact import Fact
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LEAST = 2
"""Payments of a positive term that must look wrong, and none right."""


def _declared(contract: Contract, evidence: Gathered) -> str | None:
    if any(t.kind == "individual" and t.payee == ("earner",) for t in contract.rewards.values()):
        return None
    return "no reward term is declared as individual and paid to its earner"


@check(
    "GK421",
    needs=("alternatives",),
    severity=HIGH,
    mend="pay the term to the agent whose action brings it about, or declare its payee",
    confidence=0.9,
    applies=_declared,
)
def individual_terms_land_on_who_earned_them(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """An individual reward or penalty lands on the agent that brought it about, on no other.

    An agent that is paid for what another does learns nothing from it, and the other isn't told.

    By intervention, only for terms that the contract declares as individual with
    `payee = "earner"`: where a penalty was paid, everything else that each agent could have done at
    that turn is tried. It lands on the wrong participant where none of the payee's own alternatives
    makes it smaller, while one of another's does. Where both do, it is joint, and kept. A
    positive payment can be due to something earlier, so it takes two that look wrong and none that
    looks right.

    Bad:

        if self.occupied(target):
            self.penalties[self.standing_on(target)] -= 1   # who was bumped into pays

    Good:

        if self.occupied(target):
            self.penalties[agent] -= 1                      # who drove pays
    """
    told = [(fact, _told(fact)) for fact in evidence.facts("alternatives", "payment")]
    for fact, culprit in told:
        term, is_reward = fact.value["term"], fact.value["amount"] > 0
        alike = [c for f, c in told if f.value["term"] == term and f.value["amount"] > 0]
        is_sure = not is_reward or (len([c for c in alike if c]) >= LEAST and "" not in alike)
        if culprit is None or (culprit and not is_sure):
            continue
        agent, amount = fact.value["agent"], fact.value["amount"]
        yield Occasion(
            fact.where, not culprit,
            f"{term!r} is paid to the agent that brings it about",
            f"{agent!r} is paid {amount}, which nothing else that it could do makes smaller; "
            f"another action of {culprit!r} does",
            proof=_proof(fact, culprit, evidence.api) if culprit else None,
        )  # fmt: skip


def _told(fact: Fact) -> str | None:
    """Who is to blame in the payee's place; empty: the payee is; None: it can't be told."""
    movers = fact.value["movers"]
    own = movers.get(fact.value["agent"])
    if own is None or not own["tried"]:
        return None
    if own["instead"] is not None:
        return ""
    return next((name for name, each in movers.items() if each["instead"] is not None), None)


def _proof(fact: Fact, culprit: str, api: str) -> Proof:
    payee, last = fact.value["agent"], fact.where.turn or 0
    then: dict[str, Any] = fact.value["movers"][culprit]
    turn, action = then["turn"], literal(then["instead"])
    if api == "parallel":
        action = f"{{**other[{turn}], {culprit!r}: {action}}}"
        play = f"        paid = env.step(each)[1].get({payee!r}, 0.0)\n"
    else:
        play = (
            "        env.last()\n"
            "        env.step(each)\n"
            f"        paid = env.rewards.get({payee!r}, 0.0)\n"
        )
    return Proof(
        "def payment(actions):\n"
        "    env = make()\n"
        "    env.reset(seed=SEED)\n"
        "    for each in actions:\n"
        f"{play}"
        "    return paid\n"
        "\n"
        f"actions = list(ACTIONS[:{last + 1}])\n"
        "other = list(actions)\n"
        f"other[{turn}] = {action}\n"
        f"# only what {culprit!r} does is different\n"
        "assert abs(payment(other)) >= abs(payment(actions)), (payment(other), payment(actions))",
        plays=False,
    )
