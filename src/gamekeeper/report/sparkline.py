"""Returns over episodes as small pictures of text: a sign for each episode, or for a few."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from gamekeeper.core.legible import legible
from gamekeeper.report.columns import columns_of, filled, one_cell

if TYPE_CHECKING:
    import pyarrow as pa

    from gamekeeper.core.evidence import Evidence

APART: Final = ("obs", "info", "mask", "received", "odd", "live", "action", "digest")
"""Kinds of columns that returns don't need."""
BLOCKS: Final = "▁▂▃▄▅▆▇█"
ASCII: Final = "_.-:=+*#"
"""The same eight heights where a terminal has no blocks."""
ABSENT: Final = " "
ODD: Final = "?"
"""Stands for a value that is no number (NaN, infinity)."""
INDENT: Final = "  "
GAP: Final = "  "
NARROWEST: Final = 8
"""Signs of a picture at least; below, long names push it over the edge of the terminal."""


@legible
def returns_by_episode(evidence: Evidence) -> dict[str, list[float | None]]:
    """The return of each agent in each episode, in their order; None where it had no row."""
    places = {number: k for k, number in enumerate(evidence.episodes["episode"].to_pylist())}
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

    The sum of an episode that goes on in the next rows goes before them: floats that are added in
    another order differ in their last digits.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    names, last = ["agent", "episode", "reward"], None
    for part in evidence.tables.all_parts("steps", without=APART) or ():
        rows = part.select(names)
        rows = rows if last is None else pa.concat_tables([last, rows])
        sums = rows.group_by(names[:2], use_threads=False).aggregate([("reward", "sum")])
        sums = sums.rename_columns(names)
        goes_on = pc.equal(sums["episode"], pc.max(sums["episode"]))
        yield sums.filter(pc.invert(goes_on))
        last = sums.filter(goes_on)
    if last is not None:
        yield last


def returns_text(
    returns: Mapping[str, Sequence[float | None]], *, width: int, has_blocks: bool = True
) -> str:
    """A line for each agent: its picture, and its lowest and highest return.

    Args:
        returns: by agent, a value for each episode; None where it didn't take part.
        width: columns that no line exceeds, as far as names allow.
        has_blocks: the terminal can show them; otherwise ASCII.
    """
    episodes = max((len(values) for values in returns.values()), default=0)
    names = [one_cell(name, width // 2) for name in returns]
    ends = [_ends(values) for values in returns.values()]
    before = max((columns_of(name) for name in names), default=0)
    after = max((columns_of(text) for text in ends), default=0)
    room = max(width - before - after - len(INDENT) - 2 * len(GAP), NARROWEST)
    each = math.ceil(episodes / room) if episodes > room else 1
    lines = []
    for name, values, told in zip(names, returns.values(), ends, strict=True):
        picture = sparkline(means_of(values, each), has_blocks=has_blocks)
        lines.append(f"{INDENT}{filled(name, before)}{GAP}{picture}{GAP}{told}".rstrip())
    if each > 1:
        lines.append(f"{INDENT}a sign: the mean of {each} episodes")
    return "\n".join(lines)


def sparkline(values: Sequence[float | None], *, has_blocks: bool = True) -> str:
    """A sign for each value, its height between the lowest and the highest of them.

    Equal values stand at half height. None is a blank, what is no number a question mark.
    """
    signs = BLOCKS if has_blocks else ASCII
    finite = [value for value in values if value is not None and math.isfinite(value)]
    low, high = min(finite, default=0.0), max(finite, default=0.0)
    return "".join(_sign(value, low, high, signs) for value in values)


def means_of(values: Sequence[float | None], each: int) -> list[float | None]:
    """The mean of each run of so many values, of those that are there."""
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
        return ODD
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
