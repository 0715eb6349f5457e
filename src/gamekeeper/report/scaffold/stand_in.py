"""The rules that stand in for a new task's own: which there are, and what they say in words."""

from __future__ import annotations

from typing import Final

from gamekeeper.report.scaffold.plan import EndingPlan, Plan, TermPlan

FURTHEST: Final = 5
FAULT_TURN: Final = 3
"""Steps to go at most, and at which of its actions a fault strikes an agent; both are reached
before the horizon."""
FIRST_TERM: Final = 4
"""The number of the rule of the first reward term."""


def arrival(plan: Plan) -> EndingPlan | None:
    """The ending that is reached by arriving: the first termination."""
    return next((ending for ending in plan.endings if ending.kind == "termination"), None)


def faults(plan: Plan) -> list[EndingPlan]:
    """The endings that are reached by chance: all others."""
    return [ending for ending in plan.endings if ending is not arrival(plan)]


def is_ordered_anew(plan: Plan) -> bool:
    """Whether the order of turns is made anew in each round, not the roster's."""
    return plan.api == "aec" and plan.order != "fixed"


def rules(plan: Plan) -> list[str]:
    """The stand-in rules in words, in the order of the tests."""
    found = [
        f"Each agent begins with 1 to {furthest(plan)} steps to go, drawn as the episode begins.",
        "Any action but the noop takes an agent a step on; with none left it has arrived.",
        _order_rule(plan),
        *(_term_rule(term) for term in plan.terms),
    ]
    end = arrival(plan)
    if end is not None:
        found.append(f"{_ARRIVED[end.owner if end.owner in _ARRIVED else 'role']} ({end.name!r}).")
        found[-1] = found[-1].replace("ROLE", end.owner)
    for fault in faults(plan):
        whom = {"agent": "it", "all": "all"}.get(fault.owner, f"every {fault.owner}")
        found.append(
            f"In some episodes a fault ({fault.name!r}) strikes an agent, both drawn: with the "
            f"agent's action number {fault_turn(plan)} comes the {fault.kind} of {whom}."
        )
    return [*found, "After the contract's horizon all who are left are truncated ('horizon')."]


def furthest(plan: Plan) -> int:
    """Steps to go at most."""
    return min(FURTHEST, plan.horizon)


def fault_turn(plan: Plan) -> int:
    """At which of its actions a fault strikes an agent."""
    return min(FAULT_TURN, plan.horizon)


_ARRIVED: Final = {
    "agent": "Who has arrived is terminated alone",
    "all": "Once everybody who is left has arrived, all are terminated",
    "role": "Once every ROLE who is left has arrived, all of that role are terminated",
}


def _order_rule(plan: Plan) -> str:
    groups = " before ".join(" and ".join(f"`{role}`" for role in stage) for stage in plan.stages)
    if plan.api == "parallel":
        return f"All act at once; a tick carries actions out in the order of the roster: {groups}."
    how = {
        "fixed": "in the order of the roster",
        "rotating": "each round begins with another agent of a group",
        "random": "in an order drawn for each round",
        "state": "of a group, who has furthest to go acts next",
    }[plan.order]
    return f"In a round each agent acts once, {groups}; {how}."


def _term_rule(term: TermPlan) -> str:
    who = "Who arrives" if term.earner == "all" else f"A `{term.earner}` that arrives"
    if term.kind == "individual":
        return f"{who} is paid 1.0 ({term.name!r})."
    payees = "everybody" if term.payee == "all" else f"every `{term.payee}`"
    if term.kind == "shared":
        return f"{who} has {payees} paid 1.0 ({term.name!r})."
    return f"{who} takes 1.0 from each other of {payees} ({term.name!r})."
