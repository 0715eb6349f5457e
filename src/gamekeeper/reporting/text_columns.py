"""Columns of a terminal: the width of a text, and texts filled or broken to a width."""

from __future__ import annotations

import math
import textwrap
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.contract.validation import one_line
from gamekeeper.episodes.plain_json import legible

if TYPE_CHECKING:
    import pyarrow as pa

    from gamekeeper.episodes.evidence import Evidence

DOUBLE: Final = frozenset("WF")
"""East Asian widths of characters of two columns. Source: Unicode Standard Annex 11."""
COMBINING: Final = frozenset({"Mn", "Me", "Cf"})
"""Categories of characters that take no column of their own."""
INDENT: Final = "  "
GAP: Final = "  "
ELLIPSIS: Final = "..."
MINUS: Final = "\N{MINUS SIGN}"
"""Sign between two policies whose figures are subtracted."""

_STUFFING: Final = "\ue000"
"""A private character that no text is expected to hold, for the second column of a wide one."""


def columns_of(text: str) -> int:
    """Number of columns that a text takes on a terminal."""
    return len(text) if text.isascii() else sum(map(_columns_of_sign, text))


def filled(text: str, columns: int, *, right: bool = False) -> str:
    """Fills a text up with spaces, to the left of it if it is aligned right."""
    spaces = " " * max(columns - columns_of(text), 0)
    return spaces + text if right else text + spaces


def one_cell(text: str, most: int) -> str:
    """Puts a text on one line without control characters, cut where it takes more columns.

    An agent's name may be of any length; the document has all of it.

    Args:
        most: columns that it may take, three or more.
    """
    line = one_line(text)
    if columns_of(line) <= most:
        return line
    line = line[:most]  # so that cutting character by character from here on is short
    while columns_of(line) > most - len(ELLIPSIS):
        line = line[:-1]
    return line + ELLIPSIS


def wrapped(text: str, columns: int, *, first: str = "", rest: str = "") -> list[str]:
    """Breaks a text at spaces into lines of at most so many columns.

    A word that is too long for a line is broken; a wide character there stands out by a column.

    Args:
        text: spaces in a row count as one break.
        columns: width of a line, its indent included.
    """
    # textwrap counts characters, so a wide one is written as two while it does.
    stretched = "".join(sign + _STUFFING * (_columns_of_sign(sign) - 1) for sign in text)
    lines = textwrap.wrap(
        text if text.isascii() else stretched,
        columns,
        initial_indent=first,
        subsequent_indent=rest,
        break_on_hyphens=False,
    )
    return [line.replace(_STUFFING, "") for line in lines]


def _columns_of_sign(sign: str) -> int:
    if unicodedata.category(sign) in COMBINING:
        return 0
    return 2 if unicodedata.east_asian_width(sign) in DOUBLE else 1


def item_lines(text: str, columns: int) -> list[str]:
    """An indented text whose other lines are indented once more."""
    return wrapped(text, columns, first=INDENT, rest=INDENT * 2)


def indented(text: str, columns: int) -> list[str]:
    """A text all of whose lines are indented alike."""
    return wrapped(text, columns, first=INDENT, rest=INDENT)


def block_text(title: str, lines: Iterable[str]) -> str:
    """A heading and the lines below it; empty where there are none."""
    below = list(lines)
    return "\n".join([title, *below]) if below else ""


def items_text(title: str, texts: Iterable[str], columns: int) -> str:
    """A heading and an item for each text below it; empty where there are none."""
    return block_text(title, (line for text in texts for line in item_lines(text, columns)))


def column_lines(rows: Sequence[Sequence[str]], *, width: int) -> Iterator[str]:
    """Rows in aligned, indented columns; a cell too wide for its column is broken."""
    natural = [max(map(columns_of, column)) for column in zip(*rows, strict=True)]
    widths = fitted(natural, width - len(INDENT) - len(GAP) * (len(natural) - 1))
    for row in rows:
        cells = [wrapped(cell, columns) for cell, columns in zip(row, widths, strict=True)]
        for parts in zip_longest(*cells, fillvalue=""):
            padded = (filled(part, columns) for part, columns in zip(parts, widths, strict=True))
            yield (INDENT + GAP.join(padded)).rstrip()


def fitted(natural: Sequence[int], room: int) -> list[int]:
    """Widths of columns that fit into the room: narrow ones keep theirs, wide ones share the rest.

    Args:
        natural: width of each column that would hold all its cells.
        room: columns of the terminal for all of them.
    """
    left, widths = room, [0] * len(natural)
    for done, column in enumerate(sorted(range(len(natural)), key=natural.__getitem__)):
        widths[column] = max(min(natural[column], left // (len(natural) - done)), 1)
        left -= widths[column]
    return widths


APART: Final = (
    "obs",
    "info",
    "action_mask",
    "cumulative_reward",
    "nonconforming",
    "live",
    "action",
    "digest",
)
"""Kinds of columns that returns don't need."""
BLOCKS: Final = "▁▂▃▄▅▆▇█"
ASCII: Final = "_.-:=+*#"
"""The same eight heights where a terminal has no blocks."""
ABSENT: Final = " "
NONCONFORMING: Final = "?"
"""Mark of a value that isn't finite (NaN, infinity)."""
NARROWEST: Final = 8
"""Least characters of a sparkline; long names push it over the edge of the terminal."""


@legible
def returns_by_episode(evidence: Evidence) -> dict[str, list[float | None]]:
    """The return of each agent in each episode, in order; None where it has no row."""
    places = {number: k for k, number in enumerate(evidence.episode_table["episode"].to_pylist())}
    sums: dict[tuple[str, int], float] = {}
    for part in _sums(evidence):
        for row in part.to_pylist():
            key = row["agent"], row["episode"]
            sums[key] = sums.get(key, 0.0) + float(row["reward"] or 0.0)
    present = {agent for agent, _ in sums}
    found: dict[str, list[float | None]] = {
        agent: [None] * len(places)
        for agent in evidence.manifest.get("agents") or ()
        if agent in present
    }
    for (agent, episode), total in sums.items():
        if agent in found and episode in places:
            found[agent][places[episode]] = total
    return found


def _sums(evidence: Evidence) -> Iterator[pa.Table]:
    """Sums of rewards by agent and episode, each once where rows are sorted by episode.

    The sum of an episode that continues in the next part is added before their rows: floats that
    are added in another order differ in their last digits.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    names, last = ["agent", "episode", "reward"], None
    for part in evidence.tables.all_parts("agent_steps", without=APART) or ():
        rows = part.select(names)
        rows = rows if last is None else pa.concat_tables([last, rows])
        sums = rows.group_by(names[:2], use_threads=False).aggregate([("reward", "sum")])
        sums = sums.rename_columns(names)
        is_open = pc.equal(sums["episode"], pc.max(sums["episode"]))
        yield sums.filter(pc.invert(is_open))
        last = sums.filter(is_open)
    if last is not None:
        yield last


def returns_text(
    returns: Mapping[str, Sequence[float | None]], *, width: int, has_blocks: bool = True
) -> str:
    """A line for each agent: its sparkline, and its lowest and highest return.

    Args:
        returns: by agent, a value for each episode; None where it didn't take part.
        has_blocks: the terminal can show block characters; otherwise ASCII is used.
    """
    episodes = max((len(values) for values in returns.values()), default=0)
    names = [one_cell(name, width // 2) for name in returns]
    ends = [_ends(values) for values in returns.values()]
    before = max((columns_of(name) for name in names), default=0)
    after = max((columns_of(text) for text in ends), default=0)
    room = max(width - before - after - len(INDENT) - 2 * len(GAP), NARROWEST)
    each = math.ceil(episodes / room) if episodes > room else 1
    lines = []
    for name, values, text in zip(names, returns.values(), ends, strict=True):
        line = sparkline(means_of(values, each), has_blocks=has_blocks)
        lines.append(f"{INDENT}{filled(name, before)}{GAP}{line}{GAP}{text}".rstrip())
    if each > 1:
        lines.append(f"{INDENT}each character is the mean of {each} episodes")
    return "\n".join(lines)


def sparkline(
    values: Sequence[float | None],
    *,
    has_blocks: bool = True,
    bounds: tuple[float, float] | None = None,
) -> str:
    """A character for each value, its height between `bounds`.

    Without bounds the lowest and the highest value are; equal values then have half height. None
    is a space, a value that isn't finite a question mark.
    """
    signs = BLOCKS if has_blocks else ASCII
    finite = [value for value in values if value is not None and math.isfinite(value)]
    low, high = bounds or (min(finite, default=0.0), max(finite, default=0.0))
    return "".join(_sign(value, low, high, signs) for value in values)


def means_of(values: Sequence[float | None], each: int) -> list[float | None]:
    """The mean of each group of so many values, without those that are None."""
    found: list[float | None] = []
    for start in range(0, len(values), each):
        known = [value for value in values[start : start + each] if value is not None]
        with np.errstate(all="ignore"):  # infinities of two signs have no mean: a NaN, shown as one
            found.append(float(np.mean(known)) if known else None)
    return found


def _sign(value: float | None, low: float, high: float, signs: str) -> str:
    if value is None:
        return ABSENT
    if not math.isfinite(value):
        return NONCONFORMING
    if low == high:
        return signs[len(signs) // 2 - 1]
    # divided first: the distance of two large numbers may be infinite
    part = (value / 2 - low / 2) / (high / 2 - low / 2)
    return signs[min(int(part * len(signs)), len(signs) - 1)]


def _ends(values: Sequence[float | None]) -> str:
    finite = [value for value in values if value is not None and math.isfinite(value)]
    if not finite:
        return "no number"
    low, high = f"{min(finite):.4g}", f"{max(finite):.4g}"
    return f"all {low}" if low == high else f"{low} to {high}"


LIMIT: Final = 240
"""Characters of a space in a cell of a card; a nested one takes several lines."""
FEW: Final = 6
"""Numbers of a MultiDiscrete that are written out."""
DEEPEST: Final = 8
"""Levels of nested spaces that are written out."""


def space_text(space: spaces.Space[Any] | None, *, limit: int = LIMIT) -> str:
    """The space on one line of at most `limit` characters, `?` where it isn't known."""
    return "?" if space is None else cut(_text(space, DEEPEST), limit)


def cut(text: str, limit: int) -> str:
    """The text, or its beginning with an ellipsis where it is longer than `limit`."""
    return text if len(text) <= limit else text[: max(limit - 1, 0)] + "…"


def _text(space: spaces.Space[Any], depth: int) -> str:
    name = type(space).__name__
    if depth == 0:
        return "…"
    match space:
        case spaces.Discrete():
            start = int(space.start)
            return f"Discrete({space.n})" if start == 0 else f"Discrete({space.n}, from {start})"
        case spaces.Box():
            return f"Box({_bounds(space)}, {_shape(space)}, {space.dtype})"
        case spaces.MultiDiscrete():
            counts = np.asarray(space.nvec).reshape(-1)
            listed = " ".join(str(count) for count in counts[:FEW])
            return f"MultiDiscrete({listed}{' …' if counts.size > FEW else ''})"
        case spaces.MultiBinary():
            return f"MultiBinary({_shape(space)})"
        case spaces.Text():
            return f"Text({space.min_length} to {space.max_length} characters)"
        case spaces.Dict():
            rows = (f"{key}: {_text(inner, depth - 1)}" for key, inner in space.items())
            return "{" + ", ".join(rows) + "}"
        case spaces.Tuple():
            return "(" + ", ".join(_text(inner, depth - 1) for inner in space.spaces) + ")"
        case spaces.OneOf():
            return "one of " + " | ".join(_text(inner, depth - 1) for inner in space.spaces)
        case spaces.Sequence():
            return f"Sequence({_text(space.feature_space, depth - 1)})"
        case _:
            return " ".join(repr(space).split()) if name in vars(spaces) else name


def _shape(space: spaces.Space[Any]) -> str:
    return str(list(space.shape or ()))


def _bounds(space: spaces.Box) -> str:
    """Equal bounds once; a range over all elements where they differ."""
    if space.low.size == 0:
        return "empty"
    low, high = space.low.min(), space.high.max()
    same = (space.low == low).all() and (space.high == high).all()
    return f"{low:g} to {high:g}" if same else f"within {low:g} to {high:g}"
