"""Result of an evaluation, as frozen data: the document that others read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from html import escape
from typing import Any, Final, Self

import numpy as np

from gamekeeper.episodes.outcome import TEAM
from gamekeeper.episodes.plain_json import legible
from gamekeeper.episodes.row_tables import html_table, text_lines
from gamekeeper.errors import EvidenceError
from gamekeeper.evaluation.episode_rows import RETURN, SUCCESS, Sheet
from gamekeeper.evaluation.results import Ground, Subject
from gamekeeper.evaluation.spec import Spec

KIND: Final = "evaluation"


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Results with their intervals, comparisons, cross-play, and what was refused and why.

    Attributes:
        suite: id, version and fingerprint of the suite that it is of; None where it is of none.
        environments: by name: spec, arguments, digest, version, API, roles.
        policies: by name: how many runs, their digests, whether it is a method.
        results: a row for each environment, policy, run (None: over runs), subject and metric.
        comparisons: pairs of policies on the same seeds.
        curves: learning curves by name: a row for each environment, step, subject and metric.
        overall: over all environments: aggregates of scores that share a scale, and who is above.
        crossplay: by environment: cells, best responses, fairness.
        stopping: how it was decided that enough was played; None: by number.
        refused: what isn't claimed, and why.
        claims: what may be said of policies against one another, in words.
        notes: how it was played and what the figures are about, in words.
        episodes: how many each policy played.
        fingerprint: of the raw episodes.
        evidence: runs of pairings, where they were recorded.
        commands: how to have it again.
        spec: the specification as plain data, without what stands at its default.
    """

    name: str
    suite: Mapping[str, Any] | None = None
    seed: int = 0
    level: float = 0.95
    environments: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    policies: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    results: tuple[Mapping[str, Any], ...] = ()
    comparisons: tuple[Mapping[str, Any], ...] = ()
    curves: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    overall: Mapping[str, Any] = field(default_factory=dict)
    crossplay: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    stopping: Mapping[str, Any] | None = None
    refused: tuple[Mapping[str, str], ...] = ()
    claims: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    episodes: int = 0
    fingerprint: str = ""
    evidence: tuple[Mapping[str, Any], ...] = ()
    commands: tuple[str, ...] = ()
    spec: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper evaluate --json` prints."""
        found = {each.name: getattr(self, each.name) for each in fields(self)}
        lists = {name: list(value) for name, value in found.items() if isinstance(value, tuple)}
        return {"kind": KIND, **found, **lists}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Inverse of `to_json`.

        Raises:
            EvidenceError: it is another document.
        """
        kind = data.get("kind") if isinstance(data, Mapping) else data
        if kind != KIND or "name" not in data:
            raise EvidenceError(
                "this is no evaluation",
                expected=f'"kind": "{KIND}"',
                actual=repr(kind)[:80],
                fix="name the document that gamekeeper evaluate wrote",
            )
        known = {each.name for each in fields(cls)}
        given: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in data.items()
            if name in known
        }
        return cls(**given)

    @legible
    def rows(self) -> list[list[str]]:
        """A heading and a row for each policy and subject of its return, as texts."""
        head = ["environment", "policy", "of", "return", "interval", "success"]
        return [head, *(_texts(row) for row in self.results if is_headline(row))]

    @legible
    def __str__(self) -> str:
        return "\n".join([*text_lines(self.rows()), "", *self.notes, *self.claims])

    @legible
    def _repr_html_(self) -> str:
        items = "".join(f"<li>{escape(text)}</li>" for text in (*self.notes, *self.claims))
        return f"{html_table(self.rows(), caption=self.name)}<ul>{items}</ul>"


def is_headline(row: Mapping[str, Any]) -> bool:
    """True for a row about the return of the team or of a role."""
    return bool(row["metric"] == "return" and row["scope"] != "agent")


def _texts(row: Mapping[str, Any]) -> list[str]:
    mean, success = row["mean"], row["success"]
    interval = "-"
    if mean is not None and mean["low"] is not None:
        interval = f"{mean['low']:.3f} to {mean['high']:.3f}"
    run = "" if row["run"] is None else f"#{row['run']}"
    return [
        row["environment"],
        f"{row['policy']}{run}",
        row["who"],
        "-" if mean is None else f"{mean['value']:.3f}",
        interval,
        "-" if success is None else f"{success['p']:.0%}",
    ]


PART: Final = 10
"""marl-eval's absolute metrics hold ten times the episodes of a step."""


def marl_eval_of(spec: Spec, grounds: Sequence[Ground]) -> dict[str, Any]:
    """The document: steps with a tenth of the episodes, and all of the last as absolute metrics.

    The environment is the evaluation, its tasks are the environments here, algorithms the policies
    and the learning curves. How long a policy without a curve was trained isn't known here, so its
    `step_count` is 0.
    """
    alone = {name: {0: name} for name, each in spec.policies.items() if each.curve is None}
    tasks: dict[str, Any] = {}
    for ground in grounds:
        algorithms = {
            name: _runs_of(ground, points) for name, points in {**alone, **spec.curves}.items()
        }
        tasks[ground.name] = {name: runs for name, runs in algorithms.items() if runs}
    return {spec.name: tasks}


def _runs_of(ground: Ground, points: Mapping[int, str]) -> dict[str, Any]:
    """Steps of each run of an algorithm, and its absolute metrics."""
    found: dict[str, Any] = {}
    for place, (step, policy) in enumerate(points.items()):
        for number, sheet in enumerate(ground.runs_of(policy)):
            whole = _scores(ground, sheet)
            few = {name: values[: max(len(values) // PART, 1)] for name, values in whole.items()}
            run = found.setdefault(f"run_{number}", {})
            run[f"step_{place}"] = {"step_count": step, **few}
            run["absolute_metrics"] = whole
    return found


def _scores(ground: Ground, sheet: Sheet) -> dict[str, list[float]]:
    return {
        name: [float(value) for value in values]
        for subject in ground.compared
        for metric in (RETURN, SUCCESS)
        if metric == SUCCESS or subject.scope != TEAM or ground.has_team
        for name, values in (_metric(sheet, subject, metric),)
        if len(values)
    }


def _metric(sheet: Sheet, subject: Subject, metric: str) -> tuple[str, Any]:
    values = sheet.values(metric, subject.scope, subject.name)
    name = metric if subject.scope == TEAM else f"{metric}_{subject.name}"
    return name, values[~np.isnan(values)]
