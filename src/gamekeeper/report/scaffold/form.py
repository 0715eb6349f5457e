"""The contract of a new task."""

from __future__ import annotations

import math

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.failure import Failure
from gamekeeper.core.contract.parts import (
    Ending,
    InfoField,
    Plain,
    RewardTerm,
    Role,
    Schedule,
    Seeds,
)
from gamekeeper.report.scaffold.plan import HORIZON, Form, Plan, RolePlan


def contract_of(plan: Plan) -> Contract:
    """The game form, every question answered.

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
        roles={role.name: _role(role) for role in plan.roles},
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
        failure={"team": Failure("to_go > 0")},
    )


def noop_of(form: Form) -> Plain:
    """The action of a space that does nothing: 0, or zeros in its shape."""
    if form.kind == "discrete":
        return 0
    zero: Plain = 0.0 if form.kind == "box" else 0
    for size in reversed(form.sizes):
        length = size if form.kind in ("box", "multibinary") else len(form.sizes)
        zero = (zero,) * length
        if form.kind == "multidiscrete":
            break
    return zero


def effort_code(form: Form) -> str:
    """Python for an action that does something."""
    if form.kind == "discrete":
        return "1"
    kind, shape = ("float32", form.sizes) if form.kind == "box" else ("int8", form.sizes)
    if form.kind == "multidiscrete":
        kind, shape = "int64", (len(form.sizes),)
    size: object = shape[0] if len(shape) == 1 else shape
    return f"np.ones({size}, np.{kind})"


def space_code(form: Form, *, is_action: bool = False) -> str:
    """Python for a space: a Box is 0 to 1 as an observation, -1 to 1 as an action."""
    if form.kind == "discrete":
        return f"Discrete({form.sizes[0]})"
    if form.kind == "multidiscrete":
        return f"MultiDiscrete({list(form.sizes)})"
    if form.kind == "multibinary":
        return f"MultiBinary({form.sizes[0]})"
    shape = f"({form.sizes[0]},)" if len(form.sizes) == 1 else str(tuple(form.sizes))
    return f"Box({'-1.0' if is_action else '0.0'}, 1.0, {shape}, np.float32)"


def size_of(form: Form) -> int:
    """How many numbers a value of the space has."""
    if form.kind == "discrete":
        return 1
    return len(form.sizes) if form.kind == "multidiscrete" else math.prod(form.sizes)


def _role(role: RolePlan) -> Role:
    return Role(
        agents=(f"{role.name}_*",),
        symmetric=role.count > 1,
        may_join=False,
        may_leave=False,
        noop=noop_of(role.acts),
        mask="none",
        messages=(),
    )
