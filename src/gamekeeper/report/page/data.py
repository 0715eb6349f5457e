"""What a page shows, as frozen data: tables, charts, snippets, and the sections made of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

Chart: TypeAlias = Mapping[str, Any]
"""A chart as the page's script and templates read it (assets/README.md)."""
Kind: TypeAlias = Literal["text", "name", "number", "badge", "code"]


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of a table.

    Attributes:
        text: what stands in it.
        kind: a `name` is set apart from the direction of the text around it.
        badge: the style of a badge: `kept`, `broken`, `high`, `warn`, ...
        link: a place in the player, `RUN/EPISODE/TURN`.
    """

    text: str
    kind: Kind = "text"
    badge: str = ""
    link: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table with its caption.

    Attributes:
        caption: what it shows.
        columns: headings.
        rows: as many cells in each; the first one names the row.
        note: what must be known to read it.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __bool__(self) -> bool:
        return bool(self.rows)

    @property
    def numbers(self) -> tuple[bool, ...]:
        """Which columns hold numbers, and stand at the right."""
        return tuple(
            all(row[place].kind == "number" or not row[place].text for row in self.rows)
            and any(row[place].text for row in self.rows)
            for place in range(len(self.columns))
        )


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a section: a heading, remarks, tables, charts and texts to copy.

    Attributes:
        title: empty: it has none.
        alerts: what needs attention.
        notes: remarks.
        facts: names and values.
        charts: drawn in their order.
        tables: after the charts.
        snippets: texts to copy, by their titles.
        folded: it is shown when asked for.
        anchor: its address on the page.
        is_heading: it stands there for its title alone.
    """

    title: str = ""
    alerts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    charts: tuple[Chart, ...] = ()
    tables: tuple[Table, ...] = ()
    snippets: tuple[tuple[str, str], ...] = ()
    folded: bool = False
    anchor: str = ""
    is_heading: bool = False

    def __bool__(self) -> bool:
        parts = (self.alerts, self.notes, self.facts, self.charts, self.snippets)
        return self.is_heading or any(parts) or any(self.tables)


@dataclass(frozen=True, slots=True)
class Finding:
    """One place where a promise was broken, with what to copy.

    Attributes:
        facts: where, expected, seen, mend.
        program: raises as long as the fault is there; empty where there is none.
        anchor: the address of the program on the page.
    """

    facts: tuple[tuple[str, str], ...]
    program: str
    anchor: str


@dataclass(frozen=True, slots=True)
class Judged:
    """What one check came to.

    Attributes:
        id, claim, outcome, severity, reason: as the audit has them.
        looks: how often it looked, and how often the promise was broken, in words.
        findings: the first places.
    """

    id: str
    claim: str
    outcome: str
    severity: str
    reason: str
    looks: str
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True)
class Verdicts:
    """All checks of an audit, the worst first.

    Attributes:
        summary: the counts in words, with the style of each.
        bad: broken promises, then checks that failed themselves.
        rest: by outcome, the others.
        notes: remarks.
    """

    summary: tuple[Cell, ...] = ()
    bad: tuple[Judged, ...] = ()
    rest: tuple[tuple[str, tuple[Judged, ...]], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the page.

    Attributes:
        id: its address.
        title: its heading.
        blocks: its parts; empty ones aren't shown.
        missing: why there is nothing, and what to run to have it.
    """

    id: str
    title: str
    blocks: tuple[Block, ...] = ()
    missing: str = ""
    verdicts: Verdicts | None = None

    @property
    def shown(self) -> tuple[Block, ...]:
        """The blocks that hold something."""
        return tuple(block for block in self.blocks if block)


@dataclass(frozen=True, slots=True)
class RunCard:
    """A run as the page names it.

    Attributes:
        key: its letter; of a twin the letter of its base and a word.
        name: the name of its folder.
        status: `sealed`, `open`, `recovered`, `failed`.
        api: `aec` or `parallel`.
        environment: its name.
        episodes: how many there are.
        fingerprint: of the run.
    """

    key: str
    name: str
    status: str
    api: str
    environment: str
    episodes: int
    fingerprint: str

    def to_json(self) -> dict[str, Any]:
        """Plain data for the page's script."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class Page:
    """Everything that stands on a page.

    Attributes:
        title: what it is about.
        lead: in a sentence or two.
        runs: the first one is the one that it is about.
        sections: in their order; the player stands after the agents.
        episodes: the entries of all episodes, as the page's script reads them.
        packed: the episodes that are on the page, by run and number, deflated.
        chosen: in words, which episodes those are, and where the others are.
        is_view: served by `gamekeeper view`, which is asked for episodes.
        extra: further data for the page's script.
        links: words and addresses beside those of the sections.
    """

    title: str
    lead: str
    runs: tuple[RunCard, ...]
    sections: tuple[Section, ...]
    episodes: Sequence[Mapping[str, Any]] = ()
    packed: Mapping[tuple[str, int], bytes] = field(default_factory=dict)
    chosen: str = ""
    is_view: bool = False
    extra: Mapping[str, Any] = field(default_factory=dict)
    links: tuple[tuple[str, str], ...] = ()


def name(text: object) -> Cell:
    """A cell with a name out of the evidence."""
    return Cell(str(text), "name")


def number(value: float | None, *, digits: int = 3) -> Cell:
    """A cell with a number; a dash where there is none."""
    return Cell(shown(value, digits=digits), "number")


def percent(value: float | None) -> Cell:
    """A cell with a share in per cent."""
    return Cell("-" if value is None else f"{value:.0%}", "number")


def badge(text: str, style: str) -> Cell:
    """A cell with a word that stands out."""
    return Cell(text, "badge", style)


def shown(value: float | None, *, digits: int = 3) -> str:
    """A number with so many significant digits; whole ones as they are."""
    if value is None or value != value:  # NaN is no figure
        return "-"
    if float(value).is_integer() and abs(value) < 1e9:
        return f"{int(value):,}"
    return f"{value:,.0f}" if 1000 <= abs(value) < 1e9 else f"{value:.{digits}g}"


def interval(low: float | None, high: float | None) -> str:
    """Both bounds in words; empty where there are none."""
    return "" if low is None or high is None else f"{shown(low)} to {shown(high)}"


def few(texts: Iterable[object], *, most: int = 6) -> str:
    """The first ones, and how many more there are."""
    every = [str(text) for text in texts]
    more = len(every) - most
    return ", ".join(every[:most]) + (f" and {more} more" if more > 0 else "")
