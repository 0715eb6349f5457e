"""Contents of a page as frozen data: tables, charts, snippets, and the sections made of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

import numpy as np

from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.statistics.interval import FloatArray

Chart: TypeAlias = Mapping[str, Any]
"""A chart as the page's script and templates read it (assets/README.md)."""
Kind: TypeAlias = Literal["text", "name", "number", "badge", "code"]


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of a table.

    Attributes:
        kind: a `name` keeps its own text direction.
        badge: the style of a badge: `passed`, `failed`, `high`, `warn`, ...
        link: a place in the player, `RUN/EPISODE/TURN`.
    """

    text: str
    kind: Kind = "text"
    badge: str = ""
    link: str = ""


@dataclass(frozen=True, slots=True)
class PageTable:
    """A table with its caption.

    Attributes:
        rows: a cell for each column; the first one names the row.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __bool__(self) -> bool:
        return bool(self.rows)

    @property
    def numbers(self) -> tuple[bool, ...]:
        """True for each column of numbers, which is aligned right."""
        return tuple(
            all(row[place].kind == "number" or not row[place].text for row in self.rows)
            and any(row[place].text for row in self.rows)
            for place in range(len(self.columns))
        )


@dataclass(frozen=True, slots=True)
class PageBlock:
    """A part of a section: a heading, remarks, tables, charts and texts to copy.

    Attributes:
        facts: names and values.
        charts: drawn in their order.
        tables: after the charts.
        snippets: texts to copy, by their titles.
        folded: True if it is closed at first.
        anchor: its address on the page.
        is_heading: True for a block that is a title only.
    """

    title: str = ""
    alerts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    charts: tuple[Chart, ...] = ()
    tables: tuple[PageTable, ...] = ()
    snippets: tuple[tuple[str, str], ...] = ()
    folded: bool = False
    anchor: str = ""
    is_heading: bool = False

    def __bool__(self) -> bool:
        parts = (self.alerts, self.notes, self.facts, self.charts, self.snippets)
        return self.is_heading or any(parts) or any(self.tables)


@dataclass(frozen=True, slots=True)
class Verdicts:
    """All checks of an audit, the worst first.

    Attributes:
        summary: the counts in words, with the style of each.
        bad: verdicts of failed checks, then of checks with an error, as the audit has them; with
            `cases` in words, and for each finding its `facts` and the `anchor` of its program.
        rest: those of others by outcome.
    """

    summary: tuple[Cell, ...] = ()
    bad: tuple[Mapping[str, Any], ...] = ()
    rest: tuple[tuple[str, tuple[Mapping[str, Any], ...]], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PageSection:
    """A section of the page."""

    id: str
    title: str
    blocks: tuple[PageBlock, ...] = ()
    verdicts: Verdicts | None = None

    @property
    def shown(self) -> tuple[PageBlock, ...]:
        """The blocks that aren't empty."""
        return tuple(block for block in self.blocks if block)


@dataclass(frozen=True, slots=True)
class Answer:
    """A question of the first screen, answered in a sentence.

    Attributes:
        question: one or two words.
        word: the answer in a word.
        badge: the style of this word.
        link: the address on the page of its turn, or of what backs it.
        link_text: the words of the link.
        lines: sentences that stand below it.
    """

    question: str
    text: str
    word: str = ""
    badge: str = "plain"
    link: str = ""
    link_text: str = "details"
    lines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RunCard:
    """A run as the page names it.

    Attributes:
        key: its letter; for a counterfactual the letter of its base and a word.
        name: the name of its folder.
        status: `finalized`, `open`, `recovered`, `failed`.
        api: `aec` or `parallel`.
        agents: names and roles in the order of the possible agents; an agent's place among those
            of all runs decides its colour.
    """

    key: str
    name: str
    status: str
    api: str
    environment: str
    episodes: int
    fingerprint: str
    agents: tuple[tuple[str, str], ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data for the page's script."""
        return fields_json(self)


@dataclass(frozen=True, slots=True)
class Page:
    """Everything that stands on a page.

    Attributes:
        lead: its subject in a sentence.
        answers: the first screen; beside it what was not asked, in one closed line.
        alerts: warnings at the top, such as a run that was killed.
        runs: the first one is its subject.
        sections: in their order; the player stands first.
        episodes: the entries of all episodes, as the page's script reads them.
        packed: the episodes that are on the page, by run and number, deflated.
        chosen: sentence that names these episodes.
        is_view: True if `gamekeeper view` serves it, which answers requests for episodes.
        extra: further data for the page's script.
        links: words and addresses beside those of the sections.
    """

    title: str
    lead: str
    runs: tuple[RunCard, ...]
    sections: tuple[PageSection, ...]
    episodes: Sequence[Mapping[str, Any]] = ()
    packed: Mapping[tuple[str, int], bytes] = field(default_factory=dict)
    chosen: str = ""
    is_view: bool = False
    extra: Mapping[str, Any] = field(default_factory=dict)
    links: tuple[tuple[str, str], ...] = ()
    alerts: tuple[str, ...] = ()
    answers: tuple[Answer, ...] = ()
    not_asked: PageBlock | None = None


def headings(text: str) -> tuple[str, ...]:
    """The headings of a table out of one text, in which bars stand between them."""
    return tuple(text.split(" | "))


def name(text: object) -> Cell:
    """A cell with a name out of the evidence."""
    return Cell(str(text), "name")


def number(value: float | None) -> Cell:
    """A cell with a number; a dash where there is none."""
    return Cell(shown(value), "number")


def percent(value: float | None) -> Cell:
    """A cell with a share in per cent."""
    return Cell("-" if value is None else f"{value:.0%}", "number")


def badge(text: str, style: str) -> Cell:
    """A cell with a word that stands out."""
    return Cell(text, "badge", style)


def bounds(low: float | None, high: float | None) -> Cell:
    """A cell with an interval; a dash where there is none."""
    return Cell(interval(low, high) or "-", "number")


def anchor_of(text: str) -> str:
    """A name as part of an address: only its letters and digits."""
    return "".join(sign for sign in text if sign.isascii() and sign.isalnum()) or "x"


def shown(value: float | None) -> str:
    """Formats a number with three significant digits, a whole one with all."""
    if value is None or value != value:  # NaN isn't shown
        return "-"
    if float(value).is_integer() and abs(value) < 1e9:
        return f"{int(value):,}"
    return f"{value:,.0f}" if 1000 <= abs(value) < 1e9 else f"{value:.3g}"


def interval(low: float | None, high: float | None) -> str:
    """Both bounds in words; empty where there are none."""
    return "" if low is None or high is None else f"{shown(low)} to {shown(high)}"


MOST_POINTS: Final = 400
"""Most points of a line; of more, neighbours are averaged."""
DIGITS: Final = 6


def finite(value: Any) -> float | None:
    """A number for a chart; None where there is none, or it isn't finite."""
    if value is None or isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return None
    return float(f"{float(value):.{DIGITS}g}") if np.isfinite(value) else None


def binned_line(
    id: str,  # the word that the page uses for it
    title: str,
    x: Sequence[int],
    series: Mapping[str, FloatArray],
) -> Chart:
    """A line for each series; of many points, means of neighbours with their 5 to 95 % range."""
    size = -(-len(x) // MOST_POINTS) if len(x) else 1
    starts = range(0, len(x), size)
    lines = []
    for name, values in series.items():
        parts = [values[start : start + size] for start in starts]
        line: dict[str, Any] = {"name": name, "values": [_mean(part) for part in parts]}
        if size > 1:
            line["low"] = [finite(quantile_of(part, 0.05)) for part in parts]
            line["high"] = [finite(quantile_of(part, 0.95)) for part in parts]
        lines.append(line)
    note = f"Means of {size} episodes each, with their 5 to 95 % range." if size > 1 else ""
    return {
        "id": id,
        "kind": "line",
        "title": title,
        "series": lines,
        "x": {"label": "episode", "values": [x[start] for start in starts]},
        "y": {"label": "return"},
        "note": note,
    }


def forest(
    id: str,  # the word that the page uses for it
    title: str,
    rows: Sequence[Mapping[str, Any]],
    *,
    label: str,
    note: str = "",
) -> Chart:
    """Values with their intervals, one under another; rows without a value are shown as text."""
    plain = [
        {**row, **{key: finite(row.get(key)) for key in ("value", "low", "high", "p")}}
        for row in rows
    ]
    return {
        "id": id,
        "kind": "forest",
        "title": title,
        "x": {"label": label},
        "zero": 0,
        "rows": plain,
        "note": note,
    }


def matrix(
    id: str,  # the word that the page uses for it
    title: str,
    rows: Sequence[str],
    columns: Sequence[str],
    values: Sequence[Sequence[Any]],
    *,
    labels: tuple[str, str],
    texts: Sequence[Sequence[str | None]] | None = None,
    limits: tuple[float, float] | None = None,
) -> Chart:
    """Numbers by row and column, shaded.

    Args:
        values: [rows, columns].
        labels: headings of rows and of columns.
        texts: shown in place of the numbers.
        limits: lowest and highest shade; None: the lowest and the highest value.
    """
    cells = [[finite(value) for value in row] for row in values]
    known = [value for row in cells for value in row if value is not None]
    low, high = limits or (min(known, default=0.0), max(known, default=1.0))
    chart = {
        "id": id,
        "kind": "matrix",
        "title": title,
        "row_label": labels[0],
        "column_label": labels[1],
        "rows": list(rows),
        "columns": list(columns),
        "values": cells,
        "low": low,
        "high": high,
        "middle": 0.0 if low < 0 < high else None,
        "note": "",
    }
    return chart if texts is None else {**chart, "texts": [list(row) for row in texts]}


def _mean(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return finite(known.mean()) if len(known) else None


def quantile_of(values: FloatArray, part: float) -> float | None:
    """A quantile of the values [n] that are finite; None where none is."""
    known = values[np.isfinite(values)]
    return float(np.quantile(known, part)) if len(known) else None
