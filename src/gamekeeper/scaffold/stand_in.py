"""Placeholder rules of a new task, in words."""

from __future__ import annotations

from typing import Final

from gamekeeper.scaffold.task_plan import EndingPlan, Plan, TermPlan

FURTHEST: Final = 5
FAULT_TURN: Final = 3
"""Most steps to go, and the number of an agent's action at which a fault strikes it; both are
reached before the horizon."""


def first_term(plan: Plan) -> int:
    """Number of the rule of the first reward term."""
    return 5 if plan.has_gate else 4


def arrival(plan: Plan) -> EndingPlan | None:
    """The ending that is reached by arriving: the first termination."""
    return next((ending for ending in plan.endings if ending.kind == "termination"), None)


def faults(plan: Plan) -> list[EndingPlan]:
    """The endings that are reached by chance: all others."""
    return [ending for ending in plan.endings if ending is not arrival(plan)]


def rules(plan: Plan) -> list[str]:
    """The placeholder rules in words, in the order of the tests."""
    found = [
        f"Each agent begins with 1 to {furthest(plan)} steps to go, at random.",
        "Any action but the noop takes an agent one step; after its last step it has arrived.",
        _order_rule(plan),
        *([_gate_rule(plan)] if plan.has_gate else []),
        *(_term_rule(term) for term in plan.terms),
    ]
    end = arrival(plan)
    if end is not None:
        found.append(f"{_ARRIVED[end.owner if end.owner in _ARRIVED else 'role']} ({end.name!r}).")
        found[-1] = found[-1].replace("ROLE", end.owner)
    for fault in faults(plan):
        owners = {"agent": "this agent", "all": "all agents"}
        found.append(
            f"In some episodes, at random, a fault ({fault.name!r}) strikes one agent at its "
            f"action number {fault_turn(plan)}: {fault.kind} of "
            f"{owners.get(fault.owner, f'every {fault.owner}')}."
        )
    return [*found, "After the contract's horizon all remaining agents are truncated ('horizon')."]


def furthest(plan: Plan) -> int:
    """Most steps that an agent has to go."""
    return min(FURTHEST, plan.horizon)


def fault_turn(plan: Plan) -> int:
    """Number of an agent's action at which a fault strikes it."""
    return min(FAULT_TURN, plan.horizon)


_ARRIVED: Final = {
    "agent": "An agent that has arrived is terminated alone",
    "all": "Once all remaining agents have arrived, all are terminated",
    "role": "Once every remaining ROLE has arrived, all of that role are terminated",
}


def _order_rule(plan: Plan) -> str:
    groups = " before ".join(" and ".join(f"`{role}`" for role in stage) for stage in plan.stages)
    if plan.api == "parallel":
        return f"All act at once; actions are resolved in the order of possible_agents: {groups}."
    order = {
        "none": "in the order of possible_agents",
        "fixed": "in the order of possible_agents",
        "rotating": "each round begins with another agent of a group",
        "random": "in a random order in each round",
        "state": "in a group, the agent with most steps to go acts next",
    }[plan.order]
    rule = f"In a round each agent acts once, {groups}; {order}."
    if plan.is_buffered:
        whole = "a group have" if plan.waits_for_stage else "agents have"
        rule += f" Actions are put aside, and carried out once all {whole} acted."
    return rule


def _gate_rule(plan: Plan) -> str:
    """The stand-in for all actions that exclude each other."""
    first = {
        "priority": "the first in possible_agents",
        "random": "one at random",
        "ordered": "the one that acted first",
    }[plan.conflicts]
    group = "group" if plan.waits_for_stage else "round"
    return (
        f"The last step leads through a gate, which lets one agent through in a {group}: of "
        f"several, {first}. The others stay where they are."
    )


def _term_rule(term: TermPlan) -> str:
    earner = "An agent" if term.earner == "all" else f"A `{term.earner}`"
    if term.kind == "individual":
        return f"{earner} that arrives gets 1.0 ({term.name!r})."
    payees = "every agent" if term.payee == "all" else f"every `{term.payee}`"
    if term.kind == "shared":
        return f"When {earner.lower()} arrives, {payees} gets 1.0 ({term.name!r})."
    return f"{earner} that arrives takes 1.0 from {payees} but itself ({term.name!r})."
