"""All files of a new task's package, by their paths: templates filled in from its plan."""

import textwrap
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.contract.sections import Ending, InfoField, RewardTerm, Role, Schedule, Seeds
from gamekeeper.scaffold.task_plan import (
    CLASSES,
    HORIZON,
    EndingPlan,
    Form,
    Plan,
    RolePlan,
    TermPlan,
)

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


WIDTH: Final = 96
"""Columns of a docstring's rules."""
PYTHONS: Final = ("3.11", "3.12", "3.13")
"""Versions of Python that the package's CI runs its tests on."""
FILLS: Final = {
    "box": "np.array(steps[:count]) / FURTHEST",
    "multibinary": "np.sign(steps[:count])",
    "multidiscrete": "np.minimum(steps[:count], space.nvec[:count] - 1)",
}
"""Python that fills an observation with the steps that are left, by kind of space."""


def spec_of(plan: Plan) -> str:
    """Name of the environment on the command line, in the package's folder."""
    return f"src/{plan.name}/env.py:{plan.class_name}"


def audit_line(plan: Plan) -> str:
    """The command that audits the environment in seconds, for every push."""
    return f"gamekeeper audit {spec_of(plan)} --quick"


def files_of(plan: Plan) -> dict[str, str]:
    """Texts of all files by path, in the order of reading.

    Raises:
        ContractError: two answers contradict each other.
    """
    environment = Environment(
        loader=PackageLoader("gamekeeper.scaffold"),
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # programs, in which quotes stay quotes
    )
    environment.filters |= {"code": _code, "wrapped": _wrapped}
    names = _names(plan)

    def text(template: str) -> str:
        return environment.get_template(f"{template}.j2").render(names)

    return {
        "README.md": text("README.md"),
        f"src/{plan.name}/env.py": text("env.py"),
        f"src/{plan.name}/{plan.name}.toml": contract_of(plan).to_toml(),
        f"src/{plan.name}/__init__.py": text("__init__.py"),
        "tests/test_rules.py": text("test_rules.py"),
        "tests/test_promises.py": text("test_promises.py"),
        "pyproject.toml": text("pyproject.toml"),
        ".github/workflows/tests.yml": text("workflow.yml"),
        ".gitignore": text("gitignore"),
    }


def contract_of(plan: Plan) -> Contract:
    """The structure, every question answered.

    Raises:
        ContractError: two answers contradict each other.
    """
    return Contract(
        name=f"{plan.name}_v0",
        api=plan.api,
        why=plan.why,
        schedule=Schedule(
            stages=plan.stages,
            order=plan.order,
            observe=plan.observe,
            conflicts=plan.conflicts,
            horizon=plan.horizon,
        ),
        roles={role.name: _role(role, plan) for role in plan.roles},
        rewards={
            term.name: RewardTerm(kind=term.kind, earner=(term.earner,), payee=(term.payee,))
            for term in plan.terms
        },
        endings={
            **{
                ending.name: Ending(kind=ending.kind, owner=ending.owner) for ending in plan.endings
            },
            HORIZON: Ending(kind="truncation", owner="all"),
        },
        seeds=Seeds(deterministic=True),
        infos={"to_go": InfoField(dtype="int64", shape=())},
        failure={"agent": Failure("to_go > 0")},
    )


def _role(role: RolePlan, plan: Plan) -> Role:
    # In a fixed order, or by priority, names decide which agent comes first.
    is_first_by_name = plan.conflicts == "priority" or (
        plan.order == "fixed" and (plan.observe == "after turn" or plan.conflicts == "ordered")
    )
    return Role(
        agents=(f"{role.name}_*",),
        symmetric=role.count > 1 and not is_first_by_name,
        may_join=False,
        may_leave=False,
        noop=role.acts.noop,
        mask="none",
        messages=(),
    )


def _names(plan: Plan) -> dict[str, Any]:
    """The variables of the templates."""
    is_aec = plan.api == "aec"
    first_ending = first_term(plan) + len(plan.terms)
    seen = {role.observes.kind for role in plan.roles}
    kinds = seen | {role.acts.kind for role in plan.roles} | {"box"}
    return {
        "plan": plan,
        "name": plan.class_name,
        "is_aec": is_aec,
        "is_parallelizable": not is_aec
        or (plan.observe == "after tick" and plan.order in ("none", "fixed")),
        "is_ordered_anew": is_aec and plan.order not in ("none", "fixed"),
        "rotates": plan.order == "rotating" and max(map(plan.count_of, plan.stages)) > 1,
        "rules": rules(plan),
        "furthest": furthest(plan),
        "fault_turn": fault_turn(plan),
        "first_term": first_term(plan),
        "first_ending": first_ending,
        "first_fault": first_ending + (arrival(plan) is not None),
        "arrival": arrival(plan),
        "faults": faults(plan),
        "fault_names": tuple(fault.name for fault in faults(plan)),
        "spaces": sorted(CLASSES[kind] for kind in kinds),
        "discrete": "discrete" in seen,
        "arrays": [(CLASSES[kind], fill) for kind, fill in FILLS.items() if kind in seen],
        "counts": {role.name: role.count for role in plan.staged},
        "efforts": _actions(plan, "ones"),
        "noops": _actions(plan, "zeros"),
        "stage_numbers": {role: n for n, stage in enumerate(plan.stages) for role in stage},
        "spec": spec_of(plan),
        "audit": audit_line(plan),
        "pythons": PYTHONS,
    }


def _actions(plan: Plan, values: str) -> str:
    """Python for an action of each role."""
    entries = (f'"{role.name}": {_action(role.acts, values)}' for role in plan.staged)
    return f"{{{', '.join(entries)}}}"


def _action(form: Form, values: str) -> str:
    """Python for an action, all `ones` or all `zeros`."""
    if form.kind == "discrete":
        return "1" if values == "ones" else "0"
    dtype = {"box": "float32", "multidiscrete": "int64", "multibinary": "int8"}[form.kind]
    size = form.shape[0] if len(form.shape) == 1 else form.shape
    return f"np.{values}({size}, np.{dtype})"


def _code(value: object) -> str:
    """Python for names and numbers, in the quotes that formatters write."""
    return str(value).replace("'", '"')


def _wrapped(rule: str) -> str:
    """A rule under its number, in lines that fit."""
    return textwrap.fill(
        rule,
        WIDTH,
        initial_indent=" " * 4,
        subsequent_indent=" " * 8,
        break_long_words=False,
        break_on_hyphens=False,
    )
