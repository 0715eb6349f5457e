"""Opponents: agents that are paid where others lose, as measured. Pure."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

FEWEST: Final = 20
"""Rows in which both are paid, below which nothing is said of a pair."""
AGAINST: Final = -0.5
"""Correlation of two agents' payments from which on they are opponents."""
OPPOSITE: Final = 0.5
"""The part of those rows in which one gains and the other loses."""
CANCELLING: Final = 5
"""Rows that pay anything, below which nothing is said of payments that cancel out."""
MOST_AGENTS: Final = 64
ROUNDING: Final = 1e-9


def opponents(
    paid: NDArray[np.float64], names: Sequence[str], *, of: str = "episodes"
) -> str | None:
    """Tells by payments that agents compete, so that a sum over them means nothing; None: not so.

    They do where all payments cancel out, row by row; and where of two agents one gains when the
    other loses: of the rows that pay both, opposite signs in half or more, and a correlation of
    -0.5 or less. That two share what there is makes no opponents: neither loses.

    Args:
        paid: [rows, agents] what each was paid in a turn or in an episode; NaN: it wasn't there.
        of: what the rows are, for people.
    Returns:
        A clause that says what was measured.
    """
    names = names[:MOST_AGENTS]
    table = np.nan_to_num(paid[:, : len(names)])
    rows = table[(table != 0).any(axis=1)]
    if len(names) < 2 or not len(rows):
        return None
    totals, largest = np.abs(np.nansum(paid, axis=1)), float(np.abs(rows).max())
    if len(rows) >= CANCELLING and bool((totals <= ROUNDING * largest).all()):
        return f"what agents are paid cancels out in each of {len(rows)} {of} that paid anything"
    for one, two in combinations(range(len(names)), 2):
        both = rows[(rows[:, one] != 0) & (rows[:, two] != 0)]
        if len(both) < FEWEST or min(np.ptp(both[:, one]), np.ptp(both[:, two])) == 0:
            continue
        opposite = int((both[:, one] * both[:, two] < 0).sum())
        pair = rows[:, [one, two]]
        if opposite >= OPPOSITE * len(both) and np.corrcoef(pair.T)[0, 1] <= AGAINST:
            return (
                f"{names[one]} and {names[two]} are paid with opposite signs in {opposite} of "
                f"{len(both)} {of} that pay both, and one gains as the other loses"
            )
    return None


def opponents_in(steps: pa.Table, names: Sequence[str]) -> str | None:
    """The same of a table of agent steps: by turns, else by whole episodes.

    Args:
        steps: with columns `episode`, `turn`, `agent` and `reward`.
    """
    places: dict[Any, int] = {name: place for place, name in enumerate(names)}
    columns = (steps[name].to_pylist() for name in ("episode", "turn", "agent", "reward"))
    paid = [row for row in zip(*columns, strict=True) if row[3] and row[2] in places]
    turns, episodes = [row[:2] for row in paid], [row[0] for row in paid]
    for rows, what in ((turns, "turns"), (episodes, "episodes")):
        order = {key: place for place, key in enumerate(dict.fromkeys(rows))}
        table = np.zeros((len(order), len(names)))
        for key, (_, _, agent, reward) in zip(rows, paid, strict=True):
            table[order[key], places[agent]] += reward
        found = opponents(table, names, of=what)
        if found is not None:
            return found
    return None
