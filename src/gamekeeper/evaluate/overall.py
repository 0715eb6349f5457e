"""Over environments: one figure for a policy, where their scores may be put together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from gamekeeper.core.evaluation.environments import AGGREGATES, aggregate
from gamekeeper.core.outcome import TEAM
from gamekeeper.evaluate.judge import FloatArray, Judge, shared
from gamekeeper.evaluate.results import Ground
from gamekeeper.evaluate.sheet import RETURN, SUCCESS
from gamekeeper.evaluate.spec import Spec

SCORE: Final = "score"
"""The team's return on a scale that environments share: `score = [what is 0, what is 1]`."""
Scores = dict[str, FloatArray]
"""[runs, episodes] by environment."""


def overall_of(spec: Spec, grounds: Sequence[Ground], judge: Judge) -> dict[str, Any]:
    """Aggregates over all environments, and who beats whom there; empty where there is one.

    Success is put together as it is; returns only on the scale that every environment names.
    """
    results: list[dict[str, Any]] = []
    compared: list[dict[str, Any]] = []
    if len(grounds) > 1:
        for metric in (SUCCESS, SCORE):
            scores = {name: _scores(spec, grounds, name, metric) for name in spec.policies}
            there = {name: each for name, each in scores.items() if each}
            results += [_row(spec, name, metric, each, judge) for name, each in there.items()]
            compared += _pairs(spec, metric, there, judge)
        if not results:
            judge.refuse(
                "a figure over environments",
                "no scale is shared: give every environment a success, or score = [low, high]",
            )
    return {"results": results, "comparisons": compared}


def _scores(spec: Spec, grounds: Sequence[Ground], policy: str, metric: str) -> Scores:
    """By environment; empty where one of them lacks the metric, or the policy."""
    found: Scores = {}
    for ground in grounds:
        sheets = ground.runs_of(policy)
        scale = spec.environments[ground.name].score
        if not sheets or (metric == SCORE and (scale is None or not ground.has_team)):
            return {}
        name = RETURN if metric == SCORE else SUCCESS
        values = shared([sheet.values(name, TEAM, TEAM) for sheet in sheets])
        if not values.size:
            return {}
        if metric == SCORE and scale is not None:
            values = (values - scale[0]) / (scale[1] - scale[0])
        found[ground.name] = values
    return found


def _row(spec: Spec, policy: str, metric: str, scores: Scores, judge: Judge) -> dict[str, Any]:
    is_method = spec.policies[policy].is_method
    if is_method:
        figures: dict[str, Any] = {
            each: judge.environments(scores, each, of=policy, name=["all", policy, metric])
            for each in AGGREGATES
        }
    else:
        judge.refuse(
            "intervals over all environments",
            "one checkpoint each: what would vary are training runs",
            policy,
        )
        nothing = dict.fromkeys(("low", "high", "method"))
        figures = {
            each: {"value": aggregate(scores, statistic=each), **nothing} for each in AGGREGATES
        }
    return {
        "policy": policy, "metric": metric, "environments": len(scores),
        "runs": min(map(len, scores.values())), "unit": "run" if is_method else "episode",
        **figures,
    }  # fmt: skip


def _pairs(
    spec: Spec, metric: str, scores: Mapping[str, Scores], judge: Judge
) -> Iterator[dict[str, Any]]:
    for a, b in spec.pairs:
        if a not in scores or b not in scores:
            continue
        is_run = any(spec.policies[name].is_method for name in (a, b))
        ones, twos = (_units(scores[name], is_run=is_run) for name in (a, b))
        if not is_run and any(len(ones[name]) != len(twos[name]) for name in ones):
            continue  # an episode broke off, so that they can't be paired
        found = judge.improvement(ones, twos, paired=not is_run, of=f"{a} and {b} over all")
        yield {
            "a": a, "b": b, "metric": metric, "environments": len(ones),
            "unit": "run" if is_run else "episode", "improvement": found,
        }  # fmt: skip


def _units(scores: Scores, *, is_run: bool) -> Scores:
    """[units] by environment: runs' means, or the episodes of the one checkpoint."""
    return {
        name: np.asarray(each.mean(axis=1) if is_run else each[0]) for name, each in scores.items()
    }
