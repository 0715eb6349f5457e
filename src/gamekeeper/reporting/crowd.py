"""Tables with a row for each agent, where there are too many agents to read one after the other."""

from collections.abc import Callable, Sequence
from math import isfinite
from statistics import median
from typing import Final

MOST_ROWS: Final = 16
"""Most agents with a row each."""
CROWD_LEGEND: Final = "others: the agents nearest the median, least to largest value"


def split(values: Sequence[float | None]) -> tuple[list[int], list[int]]:
    """Places of agents with a row each, and of all others.

    Few agents have their order; of a crowd, those furthest from the median come first.

    Args:
        values: of each agent, in its order; what isn't finite counts as furthest, None as nearest.
    """
    places = list(range(len(values)))
    if len(places) <= MOST_ROWS:
        return places, []
    known = [value for value in values if value is not None and isfinite(value)]
    middle = median(known) if known else 0.0

    def nearness(place: int) -> float:
        value = values[place]
        if value is None:
            return 1.0
        return -abs(value - middle) if isfinite(value) else float("-inf")

    ranked = sorted(places, key=nearness)
    return ranked[:MOST_ROWS], ranked[MOST_ROWS:]


def crowd_rows(
    rows: Sequence[Sequence[str]], values: Sequence[float | None], number: Callable[[float], str]
) -> list[Sequence[str]]:
    """The rows of outliers, and one for all others with the range of their first column.

    Args:
        rows: of each agent: its name, then its columns.
        values: of the first column.
    """
    shown, others = split(values)
    found: list[Sequence[str]] = [rows[place] for place in shown]
    if others:
        known = sorted(value for value in (values[k] for k in others) if value is not None)
        between = "-" if not known else spread(number(known[0]), number(known[-1]))
        found.append((f"{len(others)} others", between, *[""] * (len(rows[0]) - 2)))
    return found


def spread(low: str, high: str) -> str:
    """Formats `0.1 to 0.5`, or `0.1` where both are the same."""
    return low if low == high else f"{low} to {high}"
