"""Raw scores in the layout that marl-eval reads: environment, task, algorithm, run, step.

Source: github.com/instadeepai/marl-eval, README, "Data Structure for Raw Experiment data";
Gorsane et al. 2022, "Towards a standardised performance evaluation protocol for cooperative MARL".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from gamekeeper.core.outcome import TEAM
from gamekeeper.evaluate.results import Ground, Whom
from gamekeeper.evaluate.sheet import RETURN, SUCCESS, Sheet
from gamekeeper.evaluate.spec import Spec

STEP: Final = "step_0"
PART: Final = 10
"""marl-eval's absolute metrics hold ten times the episodes of a step."""


def marl_eval_of(spec: Spec, grounds: Sequence[Ground]) -> dict[str, Any]:
    """The document: one step with a tenth of the episodes, and all of them as absolute metrics.

    The environment is the evaluation, its tasks are the environments here, algorithms the policies.
    How long a policy was trained isn't known here, so `step_count` is 0.
    """
    tasks: dict[str, Any] = {}
    for ground in grounds:
        algorithms: dict[str, Any] = {}
        for name in spec.policies:
            runs = ground.runs_of(name)
            if runs:
                algorithms[name] = {
                    f"run_{number}": _run(ground, sheet) for number, sheet in enumerate(runs)
                }
        tasks[ground.name] = algorithms
    return {spec.name: tasks}


def _run(ground: Ground, sheet: Sheet) -> dict[str, Any]:
    whole = {
        name: [float(value) for value in values]
        for whom in ground.compared
        for metric in (RETURN, SUCCESS)
        if metric == SUCCESS or whom.scope != TEAM or ground.has_team
        for name, values in (_metric(sheet, whom, metric),)
        if len(values)
    }
    few = {name: values[: max(len(values) // PART, 1)] for name, values in whole.items()}
    return {STEP: {"step_count": 0, **few}, "absolute_metrics": whole}


def _metric(sheet: Sheet, whom: Whom, metric: str) -> tuple[str, Any]:
    values = sheet.values(metric, whom.scope, whom.name)
    name = metric if whom.scope == TEAM else f"{metric}_{whom.name}"
    return name, values[~np.isnan(values)]
