"""A run's figures by name, for TensorBoard, W&B or MLflow while a learner learns.

found = dict(curves.figures(gk.rollout("warehouse", policies=mine, episodes=20)))
wandb.log(found, step=10_000)
"""

from __future__ import annotations

from collections.abc import Iterator
from statistics import fmean

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import role


def figures(evidence: Evidence) -> Iterator[tuple[str, float]]:
    """Names and values of a run's figures: `picker_0/return`, `picker/return`, `team/return`."""
    by_role: dict[str, list[float]] = {}
    returns: list[float] = []
    for agent, part in evidence.summary.agents.items():
        values = part.to_json()
        for key, name in (("return_mean", "return"), ("length_mean", "length")):
            if values.get(key) is not None:
                yield f"{agent}/{name}", float(values[key])
        for key in ("share", "idle"):
            if values.get(key) is not None:
                yield f"{agent}/{key}", float(values[key])
        if values.get("return_mean") is not None:
            returns.append(float(values["return_mean"]))
            by_role.setdefault(evidence.contract.role_of(agent) or role(agent), []).append(
                returns[-1]
            )
    for name, found in by_role.items():
        if name not in evidence.summary.agents:
            yield f"{name}/return", fmean(found)
    if returns:
        yield "team/return", sum(returns)
