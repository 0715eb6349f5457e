"""The game form as it was seen, beside what is declared. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.audit.measure import form
from gamekeeper.audit.measure.advice import advice
from gamekeeper.audit.measure.influence import influence
from gamekeeper.audit.measure.payments import payments
from gamekeeper.audit.measure.symmetry import p_by_role
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered, Twin
from gamekeeper.core.layout import role
from gamekeeper.core.stats import holm

PROBES: Final[tuple[str, ...]] = ("rollout", "order", "influence")
"""Probes whose looks it reads."""
LEVEL: Final = 0.01


def measured(contract: Contract, evidence: Gathered) -> dict[str, Any]:
    """What was measured, by the names of the audit's document; None where it couldn't be.

    The contract only says which agents are of one role; nothing is judged here.
    """
    traces, twins = evidence["rollout"], list(evidence.twins("influence"))
    api = evidence.api
    schedule, order = form.schedule(traces, api), _order(evidence)
    advised, why = advice(api, schedule, order, twins)
    return {
        "schedule": schedule,
        "order_sensitive": order.get("result"),
        "deterministic": _deterministic(evidence, twins),
        "horizon": form.horizon(traces, api),
        "symmetric": _symmetric(contract, evidence),
        "reward": payments(traces),
        "endings": form.endings(traces, api),
        "influence": influence(twins),
        "advice": advised,
        "why": why,
    }


def _order(evidence: Gathered) -> dict[str, Any]:
    """What other orders of the action dictionary changed at worst, and in how many ticks."""
    found: dict[str, Any] = {}
    facts = [fact.value for fact in evidence.facts("order", "order")]
    corrected = iter(holm([p for value in facts for p in value.get("p_values", ())]))
    ranks = ("none", "draws", "outcome")
    for value in facts:
        p = min((next(corrected) for _ in value.get("p_values", ())), default=1.0)
        result = {"draws": "draws", "undecided": "draws", "outcome": "outcome"}.get(value["result"])
        if value["result"] == "noise":
            continue
        result = "outcome" if p <= LEVEL else result or "none"
        worst = max(result, found.get("result", "none"), key=ranks.index)
        found = {"result": worst, "ticks": found.get("ticks", 0) + value["ticks"]}
    return found


def _deterministic(evidence: Gathered, twins: Sequence[Twin]) -> bool | None:
    """Whether seed and actions settled every rerun; None where there was none."""
    shams = {id(twin.sham): twin.noise is None for twin in twins}
    orders = [fact.value["result"] != "noise" for fact in evidence.facts("order", "order")]
    return all([*shams.values(), *orders]) if shams or orders else None


def _symmetric(contract: Contract, evidence: Gathered) -> dict[str, Any] | None:
    """By role, whether its agents fare alike under random play, with the p-value."""
    traces = evidence["rollout"]
    p_values = p_by_role(traces, roles_of(contract, evidence))
    corrected = holm(list(p_values.values()))
    return {
        name: {"seems": bool(p > LEVEL), "p": round(p, 4), "n": len(traces)}
        for name, p in zip(p_values, corrected, strict=True)
    } or None


def roles_of(contract: Contract, evidence: Gathered) -> Mapping[str, Sequence[str]]:
    """The agents by their declared role, else by their names without a number."""
    found: dict[str, list[str]] = {}
    for agent in evidence.agents:
        found.setdefault(contract.role_of(agent) or role(agent), []).append(agent)
    return found
