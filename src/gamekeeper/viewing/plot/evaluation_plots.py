"""Plots of an evaluation: learning curves, profiles, intervals and cross-play."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal, NoReturn

import numpy as np

from gamekeeper.errors import EvidenceError
from gamekeeper.evaluation.evaluation import Evaluation
from gamekeeper.evaluation.rankings import payoffs_of
from gamekeeper.reporting.page.page_data import interval, shown
from gamekeeper.statistics.interval import Statistic
from gamekeeper.viewing.plot.plot_axes import MOST_ROWS, RAMP, axes, color, finish, name_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Row = Mapping[str, Any]
SCOPES: Final = ("team", "role", "agent")
MOST_WRITTEN: Final = 12
"""Policies up to which a mean is written into its cell."""


def curves(
    evaluation: Evaluation,
    *,
    environment: str | None = None,
    of: str | None = None,
    statistic: Statistic = "iqm",
    ax: Axes | None = None,
) -> Axes:
    """Draws learning curves: a statistic of returns at each step, with its interval.

    Intervals are those of each point by itself, not of a curve as a whole.

    Args:
        evaluation: with policies that name a `curve` and a `step`.
        environment: its name; None: the first.
        of: the team, a role or an agent; None: the team, or the first where it has no return.
        statistic: `iqm`, `mean` or `median`, over training runs.
        ax: axes to draw on; None: new ones.
    Raises:
        DependencyError: matplotlib isn't installed.
        EvidenceError: there is no learning curve of that name.
    """
    rows = [{"curve": name, **row} for name, points in evaluation.curves.items() for row in points]
    chosen, ground, subject = _chosen(evaluation, rows, environment, of, "learning curve")
    ax = axes(ax)
    for place, name in enumerate(dict.fromkeys(row["curve"] for row in chosen)):
        mine = (row for row in chosen if row["curve"] == name)
        points = sorted(mine, key=lambda row: float(row["step"]))
        _line(ax, points, statistic, name, color(place))
    title = f"{evaluation.name}: return of {subject} in {ground}"
    label = f"{'IQM' if statistic == 'iqm' else statistic} with {_level(evaluation)}"
    return finish(ax, title, x="training step", y=label, legend=True)


def profiles(
    evaluation: Evaluation,
    *,
    metric: Literal["score", "success"] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draws performance profiles: the part of the runs whose score is above each value.

    Args:
        evaluation: of several environments that share a scale.
        metric: None: `score` where it was measured, else `success`.
        ax: axes to draw on; None: new ones.
    Raises:
        DependencyError: matplotlib isn't installed.
        EvidenceError: there are no profiles of that metric.
    Source: Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical
        precipice".
    """
    rows = [row for row in evaluation.overall.get("results") or () if row.get("profile")]
    known = dict.fromkeys(row["metric"] for row in rows)
    metric = metric or ("score" if "score" in known else "success")
    chosen = [row for row in rows if row["metric"] == metric]
    if not chosen:
        _refuse(
            evaluation, f"profile of {metric}",
            "evaluate in two environments or more, each with a success or score = [low, high]",
        )  # fmt: skip
    ax = axes(ax)
    for place, row in enumerate(chosen):
        found = row["profile"]
        ax.plot(found["tau"], found["share"], label=row["policy"], color=color(place), linewidth=2)
    ax.set_ylim(-0.02, 1.02)
    unit = "runs" if chosen[0]["unit"] == "run" else "episodes"
    title = f"{evaluation.name}: performance profiles over {chosen[0]['environments']} environments"
    return finish(ax, title, x=metric, y=f"part of the {unit} above it", legend=True)


def intervals(
    evaluation: Evaluation,
    *,
    environment: str | None = None,
    of: str | None = None,
    statistic: Statistic = "mean",
    ax: Axes | None = None,
) -> Axes:
    """Draws a statistic of each policy's returns with its interval.

    A figure without an interval is an open circle; the evaluation says why it was refused.

    Args:
        evaluation: as `gk.evaluate` returned it.
        environment: its name; None: the first.
        of: the team, a role or an agent; None: the team, or the first where it has no return.
        statistic: `mean`, `iqm` or `median`.
        ax: axes to draw on; None: new ones.
    Raises:
        DependencyError: matplotlib isn't installed.
        EvidenceError: there is no such result.
    """
    chosen, ground, subject = _chosen(evaluation, evaluation.results, environment, of, "result")
    over = {row["policy"] for row in chosen if row["run"] is None}
    shown_rows = [row for row in chosen if row["run"] is None or row["policy"] not in over]
    names = [_name(evaluation, row) for row in shown_rows[:MOST_ROWS]]
    ax = axes(ax, rows=len(names))
    for place, row in enumerate(shown_rows[:MOST_ROWS]):
        figure = row[statistic] or {}
        value, low, high = (figure.get(key) for key in ("value", "low", "high"))
        fill = ax.get_facecolor()
        if low is not None and high is not None:
            ax.plot([low, high], [place, place], color=color(place), linewidth=2.4)
            fill = color(place)
        if value is not None:
            ax.plot([value], [place], "o", color=color(place), markerfacecolor=fill, markersize=7)
    name_rows(ax, names)
    label = f"{'IQM' if statistic == 'iqm' else statistic} return with {_level(evaluation)}"
    return finish(ax, f"{evaluation.name}: {subject} in {ground}", x=f"{label}; open: no interval")


def crossplay(
    evaluation: Evaluation, *, environment: str | None = None, ax: Axes | None = None
) -> Axes:
    """Draws the mean return of each pair of policies in an environment's two roles.

    Args:
        evaluation: with cross-play.
        environment: its name; None: the first with two roles.
        ax: axes to draw on; None: new ones.
    Raises:
        DependencyError: matplotlib isn't installed.
        EvidenceError: there is no cross-play of two roles.
    """
    found = {name: payoffs_of(each) for name, each in evaluation.crossplay.items()}
    ground = environment or next((name for name, each in found.items() if each), None)
    payoffs = found.get(ground or "")
    if payoffs is None:
        fix = "evaluate with crossplay between two roles, and name one of its environments"
        _refuse(evaluation, "cross-play of two roles", fix)
    names, rows = payoffs["policies"], payoffs["means"]
    means = np.array([[np.nan if x is None else x for x in row] for row in rows], np.float64)
    ax = axes(ax, rows=2 * len(names) + 3)
    picture = ax.imshow(means, cmap=RAMP, aspect="auto")
    figure = ax.get_figure()
    if figure is not None:
        figure.colorbar(picture, ax=ax, label="mean return", shrink=0.9)
    ax.set_xticks(range(len(names)), names)
    ax.set_yticks(range(len(names)), names)
    if len(names) <= MOST_WRITTEN:
        _write(ax, evaluation.crossplay[str(ground)], payoffs, means)
    title = f"{evaluation.name}: cross-play in {ground}"
    columns, heads = f"{payoffs['columns']} played by", f"{payoffs['rows']} played by"
    return finish(ax, title, x=columns, y=heads)


def _write(ax: Axes, crossed: Row, payoffs: Row, means: Any) -> None:
    """Writes each mean into its cell, its interval below."""
    positions = (payoffs["rows"], payoffs["columns"])
    between = {
        (tuple(cell["roles"][position] for position in positions), cell["mean"]): interval(
            cell.get("low"), cell.get("high")
        )
        for cell in crossed["cells"]
    }
    there = means[~np.isnan(means)]
    middle = (there.min() + there.max()) / 2 if len(there) else 0.0
    for (row, column), mean in np.ndenumerate(means):
        if np.isnan(mean):
            continue
        pair = (payoffs["policies"][row], payoffs["policies"][column])
        text = "\n".join(filter(None, [shown(float(mean)), between.get((pair, float(mean)), "")]))
        ink = "white" if mean <= middle else "black"
        ax.text(column, row, text, ha="center", va="center", fontsize=8, color=ink)


def _line(ax: Axes, points: Sequence[Row], statistic: str, name: str, own: str) -> None:
    """A curve, with a band where its points have intervals."""
    there = [row for row in points if (row[statistic] or {}).get("value") is not None]
    steps = [row["step"] for row in there]
    values = [row[statistic]["value"] for row in there]
    ax.plot(steps, values, color=own, label=name, linewidth=2, marker="o", markersize=3)
    sure = [row for row in there if row[statistic]["low"] is not None]
    low, high = ([row[statistic][key] for row in sure] for key in ("low", "high"))
    if len(sure) == 1:
        ax.vlines([sure[0]["step"]], low, high, color=own)
    ax.fill_between([row["step"] for row in sure], low, high, color=own, alpha=0.2, linewidth=0)


def _chosen(
    evaluation: Evaluation, rows: Sequence[Row], environment: str | None, of: str | None, what: str
) -> tuple[list[Row], str, str]:
    """Rows about the return of one subject in one environment, and the names of both."""
    paid = [row for row in rows if row["metric"] == "return"]
    ground = environment or next((row["environment"] for row in paid), "")
    there = [row for row in paid if row["environment"] == ground]
    ranked = sorted(there, key=lambda row: SCOPES.index(row["scope"]))
    subject = of or next((row["who"] for row in ranked), "")
    found = [row for row in there if row["who"] == subject]
    if not found:
        known = sorted({f"{row['who']} in {row['environment']}" for row in paid})
        fix = f"name one of: {', '.join(known[:8])}" if known else NO_ROWS[what]
        _refuse(evaluation, f"{what} of {subject or 'any agent'} in {ground or 'it'}", fix)
    return found, str(ground), str(subject)


NO_ROWS: Final = {
    "learning curve": "give policies a curve and a step in the specification",
    "result": "evaluate at least one policy",
}
"""By what is missing altogether, how to have it."""


def _name(evaluation: Evaluation, row: Row) -> str:
    runs = (evaluation.policies.get(row["policy"]) or {}).get("runs") or 1
    is_alone = row["run"] is None or runs == 1
    return str(row["policy"]) if is_alone else f"{row['policy']} #{row['run']}"


def _level(evaluation: Evaluation) -> str:
    return f"{evaluation.level:.0%} interval".replace("%", " %")


def _refuse(evaluation: Evaluation, what: str, fix: str) -> NoReturn:
    raise EvidenceError(
        f"the evaluation has no {what}",
        where=evaluation.name,
        expected=what,
        actual="none",
        fix=fix,
    )
