"""The game form as it was seen, beside what is declared. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.auditing.measure import form
from gamekeeper.auditing.measure.advice import advice
from gamekeeper.auditing.measure.influence import influence
from gamekeeper.auditing.measure.payments import payments
from gamekeeper.checks.endings.role_symmetry import p_by_role
from gamekeeper.checks.facts.play_facts import OrderOutcome
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import role
from gamekeeper.statistics.significance import holm

PROBES: Final[tuple[str, ...]] = ("rollout", "order", "influence", "same_seed")
"""Probes whose looks it reads."""
LEVEL: Final = 0.01


def measured(contract: Contract, evidence: ProbeEvidence) -> dict[str, Any]:
    """Measured game form, by the names of the audit's document; None where it couldn't be.

    The contract only says which agents are of one role; nothing is judged here.
    """
    traces, counterfactuals = evidence["rollout"], list(evidence.counterfactuals("influence"))
    api = evidence.api
    schedule, order = form.schedule(traces, api), _order(evidence)
    advised, why = advice(api, schedule, order, counterfactuals)
    return {
        "schedule": schedule,
        "order_sensitive": order.get("result"),
        "deterministic": _deterministic(evidence, counterfactuals),
        "horizon": form.horizon(traces, api),
        "symmetric": _symmetric(contract, evidence),
        "reward": payments(traces),
        "endings": form.endings(traces, api),
        "influence": influence(counterfactuals),
        "advice": advised,
        "why": why,
    }


def _order(evidence: ProbeEvidence) -> dict[str, Any]:
    """Effect of other orders of the action dictionary at worst, and in how many ticks."""
    found: dict[str, Any] = {}
    facts = [fact.value for fact in evidence.facts(OrderOutcome)]
    corrected = iter(holm([p for value in facts for p in value.p_values]))
    ranks = ("none", "draws", "outcome")
    for value in facts:
        p = min((next(corrected) for _ in value.p_values), default=1.0)
        result = {"draws": "draws", "undecided": "draws", "outcome": "outcome"}.get(value.result)
        if value.result == "noise":
            continue
        result = "outcome" if p <= LEVEL else result or "none"
        worst = max(result, found.get("result", "none"), key=ranks.index)
        found = {"result": worst, "ticks": found.get("ticks", 0) + value.ticks}
    return found


def _deterministic(
    evidence: ProbeEvidence, counterfactuals: Sequence[ProbeCounterfactual]
) -> bool | None:
    """Tells whether seed and actions settled every rerun; None where there was none."""
    unchanged_reruns = {
        id(counterfactual.unchanged_rerun): counterfactual.noise is None
        for counterfactual in counterfactuals
    }
    orders = [fact.value.result != "noise" for fact in evidence.facts(OrderOutcome)]
    again = [
        each.divergence is None
        for each in evidence.counterfactuals("same_seed")
        if each.change["change"] in ("nothing", "the global generators")
    ]
    reruns = [*unchanged_reruns.values(), *orders, *again]
    return all(reruns) if reruns else None


def _symmetric(contract: Contract, evidence: ProbeEvidence) -> dict[str, Any] | None:
    """By role, whether its agents fare alike under random play, with the p-value."""
    traces = evidence["rollout"]
    p_values = p_by_role(traces, roles_of(contract, evidence))
    corrected = holm(list(p_values.values()))
    return {
        name: {"seems": bool(p > LEVEL), "p": round(p, 4), "n": len(traces)}
        for name, p in zip(p_values, corrected, strict=True)
    } or None


def roles_of(contract: Contract, evidence: ProbeEvidence) -> Mapping[str, Sequence[str]]:
    """The agents by their declared role, else by their names without a number."""
    found: dict[str, list[str]] = {}
    for agent in evidence.agents:
        found.setdefault(contract.role_of(agent) or role(agent), []).append(agent)
    return found
