"""Every agent by itself: what it was paid, how it acted, how it ended. Nothing is averaged first.

"Averaged first" would be one number for the team: here the team stands last.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.core.evaluation.one_sample import one_sample
from gamekeeper.core.evaluation.refusals import FEWEST_EPISODES
from gamekeeper.core.summary import Summary
from gamekeeper.report.page.charts import binned_line
from gamekeeper.report.page.data import (
    Block,
    Cell,
    Chart,
    Table,
    badge,
    interval,
    name,
    number,
    percent,
    shown,
)
from gamekeeper.report.page.figures import Figures
from gamekeeper.report.page.pack import Seat

FloatArray = NDArray[np.float64]

FEWEST: Final = FEWEST_EPISODES["mean"]
"""Episodes below which no interval is claimed."""
MOST_INTERVALS: Final = 64
"""Agents whose intervals are worked out; one takes some hundredths of a second."""
MOST_LINES: Final = 12
"""Agents whose returns are drawn; the table has all."""
NOT_TESTED: Final = "not tested"


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean over episodes with its interval.

    Attributes:
        value: the mean; None where there is no episode.
        low, high: its 95 % interval; None where there are too few episodes for one.
        n: episodes.
    """

    value: float | None
    low: float | None
    high: float | None
    n: int


def mean_of(values: FloatArray, rng: Generator) -> Mean:
    """The mean of an agent's figures with an interval, which fewer than 50 episodes don't have.

    Args:
        values: [episodes].
        rng: draws the resamples.
    """
    if not len(values):
        return Mean(None, None, None, 0)
    value = float(np.mean(values))
    if len(values) < FEWEST or not np.isfinite(values).all():
        return Mean(value, None, None, len(values))
    found = one_sample(np.asarray(values, np.float64), rng=rng)
    return Mean(value, found.low, found.high, found.n)


def means_of(figures: Figures, rng: Generator) -> dict[str, Mean]:
    """Each agent's mean return over the episodes that it played in; equal figures once."""
    known: dict[bytes, Mean] = {}
    found = {}
    for place, agent in enumerate(figures.agents):
        values = figures.returns[figures.present[:, place], place]
        key = values.tobytes()
        if key not in known and place >= MOST_INTERVALS:
            mean = float(np.mean(values)) if len(values) else None
            found[agent] = Mean(mean, None, None, len(values))
            continue
        if key not in known:
            known[key] = mean_of(values, rng)
        found[agent] = known[key]
    return found


def agents_blocks(
    figures: Figures,
    summary: Summary,
    seats: Sequence[Seat],
    *,
    key: str,
    labels: Sequence[Mapping[str, Any]],
    attribution: Mapping[str, Any] | None,
    failed: Sequence[bool | None],
    condition: str,
    rng: Generator,
) -> tuple[Block, ...]:
    """The blocks of one run.

    Args:
        figures: of the run.
        summary: shares, idle parts and endings.
        seats: names and roles.
        key: the run's letter.
        labels: failure labels as plain data.
        attribution: the document of `gamekeeper attribute`, which alone says who is lazy.
        failed: by episode.
        condition: in words, when an episode counts as failed.
        rng: draws resamples.
    """
    means = means_of(figures, rng)
    main = Block(
        charts=tuple(filter(None, [_returns(figures, key), _terms_chart(figures, key)])),
        tables=(
            _main_table(figures, summary, means, seats, labels, attribution),
            _terms(figures),
            _labels(labels, key),
        ),
        notes=tuple(_notes(means, attribution)),
    )
    return (main, _team(figures, failed, condition, rng))


def _main_table(
    figures: Figures,
    summary: Summary,
    means: Mapping[str, Mean],
    seats: Sequence[Seat],
    labels: Sequence[Mapping[str, Any]],
    attribution: Mapping[str, Any] | None,
) -> Table:
    roles = {seat.name: seat.role for seat in seats}
    said = Counter((each["agent"], each["label"]) for each in labels)
    rows = []
    for place, agent in enumerate(figures.agents):
        values = figures.returns[figures.present[:, place], place]
        own, mean = summary.agents.get(agent), means[agent]
        rows.append((
            name(agent), name(roles.get(agent, "")), number(mean.n), number(mean.value),
            Cell(interval(mean.low, mean.high) or "-", "number"),
            number(_quantile(values, 0.0)), number(_quantile(values, 0.5)),
            number(_quantile(values, 1.0)),
            number(None if own is None else own.length_mean),
            percent(None if own is None else own.share),
            percent(None if own is None else own.idle),
            Cell("" if own is None else _counts(own.endings)),
            Cell(", ".join(f"{label}" for who, label in said if who == agent)),
            _lazy(agent, attribution),
        ))  # fmt: skip
    columns = (
        "agent", "role", "episodes", "mean return", "95 % interval", "least", "median", "most",
        "mean length", "share", "idle", "endings", "labels", "lazy",
    )  # fmt: skip
    return Table("Returns, lengths and endings by agent", columns, tuple(rows))


def _quantile(values: FloatArray, part: float) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, part)) if len(finite) else None


def _counts(endings: Mapping[str, int]) -> str:
    return ", ".join(f"{reason} {count}" for reason, count in endings.items())


def _lazy(agent: str, attribution: Mapping[str, Any] | None) -> Cell:
    """What the attribution says; nobody is called lazy, or not, without one."""
    told = ((attribution or {}).get("agents") or {}).get(agent)
    if not isinstance(told, Mapping) or "lazy" not in told:
        return Cell(NOT_TESTED)
    if told["lazy"] is None:
        return Cell("can't be told")
    return badge("lazy", "warn") if told["lazy"] else Cell("no")


def _notes(means: Mapping[str, Mean], attribution: Mapping[str, Any] | None) -> list[str]:
    notes = []
    if any(0 < mean.n < FEWEST for mean in means.values()):
        notes.append(
            f"No interval is shown for fewer than {FEWEST} episodes: it wouldn't cover as it says."
        )
    if len(means) > MOST_INTERVALS:
        notes.append(f"Intervals are worked out for the first {MOST_INTERVALS} agents.")
    notes.append(
        "Share: part of the team's return, where all have one sign. Idle: part of an agent's "
        "actions that are the declared noop."
    )
    if attribution is None:
        notes.append(
            "Who is lazy is told by replacing agents, not by their returns: run "
            "`gamekeeper attribute RUN`."
        )
    return notes


def _returns(figures: Figures, key: str) -> Chart | None:
    """Each agent's return in every episode, or means of several."""
    if len(figures.headers) < 2:
        return None
    return binned_line(
        f"returns-{key}",
        "Return by agent and episode",
        [header["episode"] for header in figures.headers],
        {
            agent: np.where(figures.present[:, place], figures.returns[:, place], np.nan)
            for place, agent in enumerate(figures.agents[:MOST_LINES])
        },
        note=f"The first {MOST_LINES} agents; the table has all of them."
        if len(figures.agents) > MOST_LINES
        else "",
    )


def _term_means(figures: Figures) -> dict[str, list[float | None]]:
    found: dict[str, list[float | None]] = {}
    for term, sums in figures.terms.items():
        found[term] = [
            float(sums[figures.present[:, place], place].mean())
            if figures.present[:, place].any()
            else None
            for place in range(len(figures.agents))
        ]
    return found


def _terms_chart(figures: Figures, key: str) -> Chart | None:
    means = _term_means(figures)
    if not means or not figures.agents:
        return None
    return {
        "id": f"terms-{key}", "kind": "bars", "title": "Mean return by reward term",
        "x": {"label": "agent", "names": list(figures.agents[:MOST_LINES])},
        "y": {"label": "mean return of an episode"},
        "series": [
            {"name": term, "values": [_finite(value) for value in values[:MOST_LINES]]}
            for term, values in means.items()
        ],
        "stacked": False,
    }  # fmt: skip


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.6g}")


def _terms(figures: Figures) -> Table:
    means = _term_means(figures)
    rows = tuple(
        (name(agent), *(number(values[place]) for values in means.values()))
        for place, agent in enumerate(figures.agents)
    )
    return Table("Mean return by reward term", ("agent", *means), rows if means else ())


def _labels(labels: Sequence[Mapping[str, Any]], key: str) -> Table:
    rows = tuple(
        (
            Cell(str(each["label"])),
            name(each["agent"] or "the team"),
            _place(each, key),
            Cell(f"{'proposed by' if each['proposed'] else 'said by'} {each['by']}"),
            Cell(str(each["why"] or "")),
        )
        for each in labels
    )
    return Table("Failure labels", ("label", "whose", "where", "by", "why"), rows)


def _place(label: Mapping[str, Any], key: str) -> Cell:
    if label["episode"] is None:
        return Cell("the run")
    turn = label["turn"]
    text = f"episode {label['episode']}" + ("" if turn is None else f", turn {turn}")
    return Cell(text, link=f"{key}/{label['episode']}/{turn or 0}")


def _team(figures: Figures, failed: Sequence[bool | None], condition: str, rng: Generator) -> Block:
    team = figures.team
    mean = mean_of(team, rng)
    told = [each for each in failed if each is not None]
    ends = Counter(str(header.get("end") or "open") for header in figures.headers)
    facts = [
        ("episodes", ", ".join(f"{count} {end}" for end, count in sorted(ends.items())) or "none"),
        ("sum of all returns", f"{shown(mean.value)} on average"
         + (f" ({interval(mean.low, mean.high)})" if mean.low is not None else "")),
        ("failed", f"{sum(told)} of {len(told)} episodes" if told else "not declared"),
        ("counts as failed", condition),
    ]  # fmt: skip
    errors = [
        (Cell(f"episode {header['episode']}"), Cell(_last_line(header["error"]), "code"))
        for header in figures.headers
        if header.get("error")
    ]
    table = Table("Errors", ("where", "error"), tuple(errors[:20]))
    return Block(title="The team, and errors", facts=tuple(facts), tables=(table,))


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else "no text"
