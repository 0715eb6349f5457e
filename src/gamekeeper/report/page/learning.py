"""Returns over time by the versions of policies: each agent's, and while others changed theirs.

An agent that learns changes the game that the others play. Where an agent's own version stayed and
others' changed, what changed for it is no learning of its own: that is shown apart.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from statistics import NormalDist
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.report.page.agents import FEWEST, MOST_LINES, mean_of
from gamekeeper.report.page.charts import finite
from gamekeeper.report.page.data import (
    Block,
    Cell,
    Chart,
    Section,
    Table,
    few,
    interval,
    name,
    number,
)
from gamekeeper.report.page.figures import Figures

FloatArray = NDArray[np.float64]
Profile = Mapping[str, str]
"""By agent, its policy and that policy's version."""

MOST_ROWS: Final = 200
"""Of a table; the chart has all stretches."""
SHORT: Final = 12
"""Characters of a version: digests are long."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Episodes in a row that were played by the same versions.

    Attributes:
        run: letter of the run.
        first, last: episodes.
        profile: who was played by what.
        returns: by agent, [episodes].
        changed: agents whose version isn't that of the stretch before.
    """

    run: str
    first: int
    last: int
    profile: Profile
    returns: Mapping[str, FloatArray]
    changed: frozenset[str]

    def __str__(self) -> str:
        return f"{self.run}: {self.first} to {self.last}"


def learning_section(runs: Sequence[tuple[str, Figures]], rng: Generator) -> Section:
    """Returns by version, agent by agent; runs follow one another as they were given.

    Args:
        runs: letters and figures of runs of one environment.
        rng: draws the resamples.
    """
    title = "Learning over time"
    stretches = stretches_of(runs)
    if len(stretches) < 2:
        return Section(
            "learning",
            title,
            missing="All episodes were played by one version of every policy. Policies that carry "
            "a `version`, recorded while they learn, are compared here.",
        )
    block = Block(
        charts=(_chart(stretches, rng),),
        tables=(_nonstationary(stretches), _versions(stretches, rng)),
        notes=(
            "A stretch is a row of episodes that were played by the same versions. Where an "
            "agent's return moves while its own version stays, the others moved it.",
        ),
    )
    return Section("learning", title, (block,))


def stretches_of(runs: Sequence[tuple[str, Figures]]) -> list[Stretch]:
    """The stretches of all runs, in their order."""
    found: list[Stretch] = []
    for key, figures in runs:
        places: list[int] = []
        profiles = [profile_of(header) for header in figures.headers]
        for place, profile in enumerate(profiles):
            if places and profile != profiles[places[-1]]:
                found.append(_stretch(key, figures, places, profiles[places[0]], found))
                places = []
            places.append(place)
        if places:
            found.append(_stretch(key, figures, places, profiles[places[0]], found))
    return found


def profile_of(header: Mapping[str, Any]) -> dict[str, str]:
    """By agent, `policy version`; empty where the episode names none."""
    return {
        agent: f"{each.get('policy')} {str(each.get('version'))[:SHORT]}"
        for agent, each in _policies(header).items()
    }


def names_of(header: Mapping[str, Any]) -> dict[str, str]:
    """By agent, its policy's name, whatever the version."""
    return {agent: str(each.get("policy")) for agent, each in _policies(header).items()}


def _policies(header: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    try:
        told = json.loads(header.get("policies") or "{}")
    except ValueError:
        return {}
    if not isinstance(told, Mapping):
        return {}
    return {str(agent): each for agent, each in told.items() if isinstance(each, Mapping)}


def _stretch(
    key: str, figures: Figures, places: Sequence[int], profile: Profile, before: Sequence[Stretch]
) -> Stretch:
    returns = {
        agent: figures.returns[rows, column]
        for column, agent in enumerate(figures.agents)
        for rows in [[place for place in places if figures.present[place, column]]]
    }
    last = before[-1].profile if before else profile
    changed = frozenset(agent for agent in profile if profile[agent] != last.get(agent))
    headers = figures.headers
    first, end = headers[places[0]]["episode"], headers[places[-1]]["episode"]
    return Stretch(key, first, end, profile, returns, changed)


def _agents(stretches: Sequence[Stretch]) -> list[str]:
    return list(dict.fromkeys(agent for each in stretches for agent in each.returns))


def _chart(stretches: Sequence[Stretch], rng: Generator) -> Chart:
    series = []
    for agent in _agents(stretches)[:MOST_LINES]:
        means = [mean_of(each.returns.get(agent, np.empty(0)), rng) for each in stretches]
        line: dict[str, Any] = {"name": agent, "values": [finite(mean.value) for mean in means]}
        if any(mean.low is not None for mean in means):
            line |= {"low": [finite(mean.low) for mean in means],
                     "high": [finite(mean.high) for mean in means]}  # fmt: skip
        series.append(line)
    starts = [
        {"x": place, "text": f"run {each.run}"}
        for place, each in enumerate(stretches)
        if place and each.run != stretches[place - 1].run
    ]
    return {
        "id": "learning", "kind": "line", "title": "Mean return by stretch of one version each",
        "x": {"label": "stretch", "values": list(range(len(stretches)))},
        "y": {"label": "mean return of an episode"}, "series": series,
        "note": f"Bands: 95 % intervals, where a stretch has {FEWEST} episodes or more.",
        **({"marks": starts} if starts else {}),
    }  # fmt: skip


def _nonstationary(stretches: Sequence[Stretch]) -> Table:
    """Agents whose own version stayed while others' changed, and how their return moved."""
    rows: list[tuple[Cell, ...]] = []
    for place in range(1, len(stretches)):
        before, after = stretches[place - 1], stretches[place]
        if not after.changed:
            continue
        for agent in after.profile:
            if agent in after.changed or agent not in before.returns:
                continue
            one, two = before.returns[agent], after.returns.get(agent, np.empty(0))
            if len(one) and len(two):
                rows.append((
                    name(agent), Cell(str(after)), name(few(sorted(after.changed), most=3)),
                    number(float(two.mean() - one.mean())), _welch(one, two),
                    number(len(one)), number(len(two)),
                ))  # fmt: skip
    columns = (
        "agent, its version unchanged", "from stretch", "who changed", "its return moved by",
        "95 % interval", "episodes before", "after",
    )  # fmt: skip
    note = f"An interval needs {FEWEST} episodes on both sides (Welch)." if rows else ""
    more = f" The first {MOST_ROWS} of {len(rows)}." if len(rows) > MOST_ROWS else ""
    return Table("Moved by others' learning", columns, tuple(rows[:MOST_ROWS]), note + more)


def _welch(one: FloatArray, two: FloatArray) -> Cell:
    """An interval of the difference of two means, from samples of their own.

    Source: Welch 1947, "The generalization of Student's problem when several different population
        variances are involved"; with the normal quantile, both samples being large.
    """
    is_finite = np.isfinite(one).all() and np.isfinite(two).all()
    if min(len(one), len(two)) < FEWEST or not is_finite:
        return Cell("-", "number")
    value = float(two.mean() - one.mean())
    error = sqrt(one.var(ddof=1) / len(one) + two.var(ddof=1) / len(two))
    far = NormalDist().inv_cdf(0.975) * error
    return Cell(interval(value - far, value + far), "number")


def _versions(stretches: Sequence[Stretch], rng: Generator) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for each in stretches:
        for agent, values in each.returns.items():
            if not len(values) or len(rows) >= MOST_ROWS:
                continue
            mean = mean_of(values, rng)
            version = each.profile.get(agent, "not named")
            rows.append((
                name(agent), Cell(str(each)), name(version),
                Cell("new" if agent in each.changed else ""), number(mean.n), number(mean.value),
                Cell(interval(mean.low, mean.high) or "-", "number"),
            ))  # fmt: skip
    columns = ("agent", "stretch", "version", "", "episodes", "mean return", "95 % interval")
    every = sum(len(each.returns) for each in stretches)
    note = f"The first {MOST_ROWS} of {every}." if every > MOST_ROWS else ""
    return Table("Returns by version", columns, tuple(rows), note)
