"""Section of the agents: each one's returns, lengths and endings; the team stands last."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from gamekeeper.episodes.summary import Summary
from gamekeeper.errors import EvidenceError
from gamekeeper.reporting.crowd import split
from gamekeeper.reporting.page.episode_figures import Figures, failed_text
from gamekeeper.reporting.page.packed_episode import PackedAgent
from gamekeeper.reporting.page.page_data import (
    Cell,
    Chart,
    PageBlock,
    PageTable,
    badge,
    binned_line,
    bounds,
    finite,
    headings,
    interval,
    name,
    number,
    percent,
    quantile_of,
    shown,
)
from gamekeeper.reporting.results_text import last_line
from gamekeeper.statistics.interval import FEWEST_EPISODES, FloatArray
from gamekeeper.statistics.one_sample import one_sample

FEWEST: Final = FEWEST_EPISODES["mean"]
"""Episodes from which an interval is shown."""
MOST_INTERVALS: Final = 64
"""Agents whose intervals are computed; one takes some hundredths of a second."""
NOT_TESTED: Final = "not tested"
SILENT: Final = ("", "-", NOT_TESTED)
"""Texts of cells that say nothing; a column of nothing else is left out."""


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean over episodes with its interval.

    Attributes:
        value: the mean; None where there is no episode.
        low, high: its 95 % interval; None where there are too few episodes for one.
    """

    value: float | None
    low: float | None
    high: float | None
    n: int


def mean_of(values: FloatArray, rng: Generator | None) -> Mean:
    """The mean of an agent's figures with an interval, which few episodes don't have.

    Args:
        values: [episodes].
        rng: draws the resamples; None: no interval.
    """
    value = float(np.mean(values)) if len(values) else None
    if rng is None or len(values) < FEWEST or not np.isfinite(values).all():
        return Mean(value, None, None, len(values))
    try:
        found = one_sample(np.asarray(values, np.float64), rng=rng)
    except EvidenceError:  # all returns are one number
        return Mean(value, None, None, len(values))
    return Mean(value, found.low, found.high, found.n)


def means_of(figures: Figures, rng: Generator) -> dict[str, Mean]:
    """Each agent's mean return over its episodes; agents with equal returns share one interval."""
    known: dict[bytes, Mean] = {}
    found = {}
    for place, agent in enumerate(figures.agents):
        values = figures.returns[figures.present[:, place], place]
        key = values.tobytes()
        if place < MOST_INTERVALS and key not in known:
            known[key] = mean_of(values, rng)
        found[agent] = known.get(key) or mean_of(values, None)
    return found


def agents_blocks(
    figures: Figures,
    summary: Summary,
    roster: Sequence[PackedAgent],
    *,
    key: str,
    labels: Sequence[Mapping[str, Any]],
    attribution: Mapping[str, Any] | None,
    failed: Sequence[bool | None],
    condition: str,
    rng: Generator,
) -> tuple[PageBlock, ...]:
    """The blocks of one run.

    Args:
        summary: shares, idle parts and endings.
        attribution: the document of `gamekeeper attribute`, which alone tells lazy agents.
        failed: True for each episode that failed; None where it isn't known.
        condition: condition of a failed episode, in words.
    """
    means = means_of(figures, rng)
    table = _main_table(figures, summary, means, roster, labels, attribution)
    first, others = split([means[agent].value for agent in figures.agents])
    main = PageBlock(
        notes=(f"Of {len(means)} agents those furthest from the median.",) if others else (),
        charts=tuple(
            filter(None, [_returns(figures, key, first), _terms_chart(figures, key, first)])
        ),
        tables=(
            replace(table, rows=tuple(table.rows[place] for place in first)),
            _labels(labels, key),
        ),
    )
    every = PageBlock(
        title=f"All {len(means)} agents", tables=(table, _terms(figures)), folded=True
    )
    notes = PageBlock(notes=tuple(_notes(means, summary, attribution)))
    return (main, *([every] if others else []), notes, _team(figures, failed, condition, rng))


def _main_table(
    figures: Figures,
    summary: Summary,
    means: Mapping[str, Mean],
    roster: Sequence[PackedAgent],
    labels: Sequence[Mapping[str, Any]],
    attribution: Mapping[str, Any] | None,
) -> PageTable:
    roles = {member.name: member.role for member in roster}
    given = dict.fromkeys((each["agent"], str(each["label"])) for each in labels)
    rows = []
    for place, agent in enumerate(figures.agents):
        values = figures.returns[figures.present[:, place], place]
        own, mean = summary.agents.get(agent), means[agent]
        rows.append(
            (
                name(agent),
                name(roles.get(agent, "")),
                number(mean.n),
                number(mean.value),
                bounds(mean.low, mean.high),
                number(quantile_of(values, 0.0)),
                number(quantile_of(values, 0.5)),
                number(quantile_of(values, 1.0)),
                number(None if own is None else own.length_mean),
                percent(None if own is None else own.share),
                percent(None if own is None else own.idle),
                Cell(", ".join(f"{why} {n}" for why, n in own.endings.items()) if own else ""),
                Cell(", ".join(label for labelled, label in given if labelled == agent)),
                _lazy(agent, attribution),
            )
        )
    columns = headings(
        "agent | role | episodes | mean return | 95 % interval | lowest | median | highest | "
        "mean length | share | idle | endings | labels | lazy"
    )
    kept = [k for k in range(len(columns)) if any(row[k].text not in SILENT for row in rows)]
    return PageTable(
        "Returns, lengths and endings by agent",
        tuple(columns[k] for k in kept),
        tuple(tuple(row[k] for k in kept) for row in rows),
    )


def _lazy(agent: str, attribution: Mapping[str, Any] | None) -> Cell:
    """The attribution's answer; without one, laziness isn't tested."""
    part = ((attribution or {}).get("agents") or {}).get(agent)
    if not isinstance(part, Mapping) or "lazy" not in part:
        return Cell(NOT_TESTED)
    return lazy_cell(part["lazy"])


def lazy_cell(is_lazy: bool | None) -> Cell:
    """A cell that tells if an agent is lazy; None: unknown."""
    if is_lazy is None:
        return Cell("unknown")
    return badge("lazy", "warn") if is_lazy else Cell("no")


def _notes(
    means: Mapping[str, Mean], summary: Summary, attribution: Mapping[str, Any] | None
) -> list[str]:
    notes = []
    if any(0 < mean.n < FEWEST for mean in means.values()):
        notes.append(
            f"No interval is shown for fewer than {FEWEST} episodes: its coverage would be wrong."
        )
    if len(means) > MOST_INTERVALS:
        notes.append(f"Intervals are computed for the first {MOST_INTERVALS} agents.")
    if any(own.share is not None for own in summary.agents.values()):
        notes.append("Share: part of the team's return, where no agent's is negative.")
    if any(own.idle is not None for own in summary.agents.values()):
        notes.append("Idle: part of an agent's actions that are the declared noop.")
    if attribution is None:
        notes.append(
            "Lazy agents are found by replacing them, not by their returns: "
            "`gamekeeper attribute RUN`."
        )
    return notes


def _returns(figures: Figures, key: str, places: Sequence[int]) -> Chart | None:
    """Each agent's return in every episode, or means of several."""
    if len(figures.headers) < 2:
        return None
    return binned_line(
        f"returns-{key}",
        "Return by agent and episode",
        [header["episode"] for header in figures.headers],
        {
            figures.agents[place]: np.where(
                figures.present[:, place], figures.returns[:, place], np.nan
            )
            for place in places
        },
    )


def _term_means(figures: Figures) -> dict[str, list[float | None]]:
    return {
        term: [
            mean_of(sums[figures.present[:, place], place], None).value
            for place in range(len(figures.agents))
        ]
        for term, sums in figures.terms.items()
    }


def _terms_chart(figures: Figures, key: str, places: Sequence[int]) -> Chart | None:
    means = _term_means(figures)
    if not means or not figures.agents:
        return None
    return {
        "id": f"terms-{key}",
        "kind": "bars",
        "title": "Mean return by reward term",
        "x": {"label": "agent", "names": [figures.agents[place] for place in places]},
        "y": {"label": "mean return of an episode"},
        "series": [
            {"name": term, "values": [finite(values[place]) for place in places]}
            for term, values in means.items()
        ],
    }


def _terms(figures: Figures) -> PageTable:
    means = _term_means(figures)
    rows = tuple(
        (name(agent), *(number(values[place]) for values in means.values()))
        for place, agent in enumerate(figures.agents)
    )
    return PageTable("Mean return by reward term", ("agent", *means), rows if means else ())


def _labels(labels: Sequence[Mapping[str, Any]], key: str) -> PageTable:
    rows = tuple(
        (
            Cell(str(each["label"])),
            name(each["agent"] or "the team"),
            _place(each, key),
            Cell(f"{'proposed by ' if each['proposed'] else ''}{each['by']}"),
            Cell(str(each["why"] or "")),
        )
        for each in labels
    )
    return PageTable("Failure labels", ("label", "agent", "place", "author", "reason"), rows)


def _place(label: Mapping[str, Any], key: str) -> Cell:
    if label["episode"] is None:
        return Cell("the run")
    turn = label["turn"]
    text = f"episode {label['episode']}" + ("" if turn is None else f", turn {turn}")
    return Cell(text, link=f"{key}/{label['episode']}/{turn or 0}")


def _team(
    figures: Figures, failed: Sequence[bool | None], condition: str, rng: Generator
) -> PageBlock:
    mean = mean_of(figures.team, rng)
    ends = Counter(str(header.get("end") or "open") for header in figures.headers)
    facts = [
        ("episodes", ", ".join(f"{count} {end}" for end, count in sorted(ends.items())) or "none"),
        (
            "mean team return",
            shown(mean.value)
            + (f" ({interval(mean.low, mean.high)})" if mean.low is not None else ""),
        ),
        ("outcome", failed_text(failed)),
        ("failure condition", condition),
    ]
    errors = [
        (Cell(f"episode {header['episode']}"), Cell(last_line(header["error"]), "code"))
        for header in figures.headers
        if header.get("error")
    ]
    table = PageTable("Errors", ("episode", "error"), tuple(errors[:20]))
    return PageBlock(title="Team and errors", facts=tuple(facts), tables=(table,))
