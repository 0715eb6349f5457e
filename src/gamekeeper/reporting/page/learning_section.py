"""Section of learning: returns over time, by the versions of policies.

An agent that learns changes the game that the others play. Changes of an agent's return while its
own version stayed and others' changed aren't its own learning, and are shown in their own table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import sqrt
from statistics import NormalDist
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from gamekeeper.reporting.crowd import MOST_ROWS as MOST_LINES
from gamekeeper.reporting.page.agent_section import FEWEST, mean_of
from gamekeeper.reporting.page.episode_figures import Figures
from gamekeeper.reporting.page.packed_values import fields_of_text
from gamekeeper.reporting.page.page_data import (
    Cell,
    Chart,
    PageBlock,
    PageSection,
    PageTable,
    bounds,
    finite,
    headings,
    name,
    number,
)
from gamekeeper.reporting.results_text import few
from gamekeeper.statistics.interval import FloatArray

Profile = Mapping[str, str]
"""By agent, its policy and that policy's version."""

MOST_ROWS: Final = 200
"""Rows of a table; the chart has all phases."""
SHORT: Final = 12
"""Characters of a version: digests are long."""


@dataclass(frozen=True, slots=True)
class LearningPhase:
    """Consecutive episodes that were played by the same versions of all policies.

    Attributes:
        first, last: episodes.
        profile: policy and version of each agent.
        returns: by agent, [episodes].
        changed: agents whose version differs from that of the phase before.
    """

    run: str
    first: int
    last: int
    profile: Profile
    returns: Mapping[str, FloatArray]
    changed: frozenset[str]

    def __str__(self) -> str:
        return f"{self.run}: {self.first} to {self.last}"


def learning_section(runs: Sequence[tuple[str, Figures]], rng: Generator) -> PageSection | None:
    """Returns by version, agent by agent; None of one version. Runs follow one another."""
    phases = phases_of(runs)
    if len(phases) < 2:
        return None
    block = PageBlock(
        charts=(_chart(phases, rng),),
        tables=(_nonstationary(phases), _versions(phases, rng)),
        notes=(
            "A phase is a series of episodes that were played by the same versions. If an agent's "
            "return changes while its own version stays, the others' learning changed it.",
        ),
    )
    return PageSection("learning", "Learning over time", (block,))


def phases_of(runs: Sequence[tuple[str, Figures]]) -> list[LearningPhase]:
    """The phases of all runs, in their order."""
    found: list[LearningPhase] = []
    for key, figures in runs:
        profiles = [profile_of(header) for header in figures.headers]
        for profile, group in groupby(range(len(profiles)), key=profiles.__getitem__):
            found.append(_phase(key, figures, list(group), profile, found))
    return found


def profile_of(header: Mapping[str, Any]) -> dict[str, str]:
    """By agent, `policy version`; empty where the episode has none."""
    return {
        agent: f"{each.get('policy')} {str(each.get('version'))[:SHORT]}"
        for agent, each in _policies(header).items()
    }


def names_of(header: Mapping[str, Any]) -> dict[str, str]:
    """By agent, its policy's name without the version."""
    return {agent: str(each.get("policy")) for agent, each in _policies(header).items()}


def _policies(header: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    policies = fields_of_text(header.get("policies")).items()
    return {agent: each for agent, each in policies if isinstance(each, Mapping)}


def _phase(
    key: str,
    figures: Figures,
    places: Sequence[int],
    profile: Profile,
    before: Sequence[LearningPhase],
) -> LearningPhase:
    returns = {
        agent: figures.returns[rows, column]
        for column, agent in enumerate(figures.agents)
        for rows in [[place for place in places if figures.present[place, column]]]
    }
    last = before[-1].profile if before else profile
    changed = frozenset(agent for agent in profile if profile[agent] != last.get(agent))
    headers = figures.headers
    first, end = headers[places[0]]["episode"], headers[places[-1]]["episode"]
    return LearningPhase(key, first, end, profile, returns, changed)


def _chart(phases: Sequence[LearningPhase], rng: Generator) -> Chart:
    series = []
    agents = dict.fromkeys(agent for each in phases for agent in each.returns)
    for agent in list(agents)[:MOST_LINES]:
        means = [mean_of(each.returns.get(agent, np.empty(0)), rng) for each in phases]
        line: dict[str, Any] = {"name": agent, "values": [finite(mean.value) for mean in means]}
        if any(mean.low is not None for mean in means):
            line |= {
                "low": [finite(mean.low) for mean in means],
                "high": [finite(mean.high) for mean in means],
            }
        series.append(line)
    starts = [
        {"x": place, "text": f"run {each.run}"}
        for place, each in enumerate(phases)
        if place and each.run != phases[place - 1].run
    ]
    return {
        "id": "learning",
        "kind": "line",
        "title": "Mean return by phase",
        "x": {"label": "phase", "values": list(range(len(phases)))},
        "y": {"label": "mean return of an episode"},
        "series": series,
        "note": f"Bands: 95 % intervals, where a phase has {FEWEST} episodes or more.",
        **({"marks": starts} if starts else {}),
    }


def _nonstationary(phases: Sequence[LearningPhase]) -> PageTable:
    """Changes of return of agents whose own version stayed while others' changed."""
    rows: list[tuple[Cell, ...]] = []
    for place in range(1, len(phases)):
        before, after = phases[place - 1], phases[place]
        if not after.changed:
            continue
        for agent in after.profile:
            if agent in after.changed or agent not in before.returns:
                continue
            one, two = before.returns[agent], after.returns.get(agent, np.empty(0))
            if len(one) and len(two):
                rows.append(
                    (
                        name(agent),
                        Cell(str(after)),
                        name(few(sorted(after.changed), most=3)),
                        number(float(two.mean() - one.mean())),
                        _welch(one, two),
                        number(len(one)),
                        number(len(two)),
                    )
                )
    columns = headings(
        "agent with the same version | from phase | agents with a new version | "
        "change of return | 95 % interval | episodes before | after"
    )
    note = f"An interval needs {FEWEST} episodes on both sides (Welch)." if rows else ""
    more = f" The first {MOST_ROWS} of {len(rows)}." if len(rows) > MOST_ROWS else ""
    return PageTable("Changed by others' learning", columns, tuple(rows[:MOST_ROWS]), note + more)


def _welch(one: FloatArray, two: FloatArray) -> Cell:
    """Interval of the difference of two means, from independent samples.

    Source: Welch 1947, "The generalization of Student's problem when several different population
        variances are involved"; with the normal quantile, both samples being large.
    """
    is_finite = np.isfinite(one).all() and np.isfinite(two).all()
    if min(len(one), len(two)) < FEWEST or not is_finite:
        return Cell("-", "number")
    value = float(two.mean() - one.mean())
    error = sqrt(one.var(ddof=1) / len(one) + two.var(ddof=1) / len(two))
    far = NormalDist().inv_cdf(0.975) * error
    return bounds(value - far, value + far)


def _versions(phases: Sequence[LearningPhase], rng: Generator) -> PageTable:
    rows: list[tuple[Cell, ...]] = []
    for each in phases:
        for agent, values in each.returns.items():
            if not len(values) or len(rows) >= MOST_ROWS:
                continue
            mean = mean_of(values, rng)
            version = each.profile.get(agent, "not named")
            rows.append(
                (
                    name(agent),
                    Cell(str(each)),
                    name(version),
                    Cell("new" if agent in each.changed else ""),
                    number(mean.n),
                    number(mean.value),
                    bounds(mean.low, mean.high),
                )
            )
    columns = ("agent", "phase", "version", "changed", "episodes", "mean return", "95 % interval")
    every = sum(len(each.returns) for each in phases)
    note = f"The first {MOST_ROWS} of {every}." if every > MOST_ROWS else ""
    return PageTable("Returns by version", columns, tuple(rows), note)
