"""Rankings of policies that beat one another: cycles, and alpha-rank where there is one."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.statistics.interval import FloatArray

Beats = NDArray[np.bool_]
"""[policies, policies] whether the row's policy is above the column's."""

_RARE: Final = 0.01
"""Chance of a change to a weaker policy, in the limit of strong selection."""


def cycle_of(beats: Beats) -> list[int]:
    """A shortest cycle of policies, each of which beats the next; empty where there is none."""
    found: list[int] = []
    for start in range(len(beats)):
        paths, seen = [[start]], {start}
        # Breadth first: the first path back to its start is a shortest from there.
        while paths and not (found and len(paths[0]) >= len(found)):
            path = paths.pop(0)
            ahead = np.flatnonzero(beats[path[-1]]).tolist()
            if start in ahead:
                found = path
                break
            fresh = [each for each in ahead if each not in seen]
            seen.update(fresh)
            paths += [[*path, each] for each in fresh]
    return found


def alpha_rank(beats: Beats) -> FloatArray:
    """Share of time that a population plays each policy, where better ones take over.

    The stationary distribution of the chain that goes from a policy to any other with equal
    chance, and stays there if that one beats it; with half of it if neither beats the other.

    Args:
        beats: [policies, policies].
    Returns:
        [policies], adding up to 1.
    Source: Omidshafiei et al. 2019, "alpha-Rank: multi-agent evaluation by evolution", 2.5 (one
        population, infinite alpha).
    """
    count = len(beats)
    if count == 1:
        return np.ones(1)
    chance = np.where(beats.T, 1 - _RARE, np.where(beats, _RARE, 0.5)) / (count - 1)
    np.fill_diagonal(chance, 0.0)
    np.fill_diagonal(chance, 1 - chance.sum(axis=1))
    # A stationary row p solves p (chance - 1) = 0 and sums to 1: one equation more than unknowns.
    balance = np.vstack([chance.T - np.eye(count), np.ones(count)])
    found, *_ = np.linalg.lstsq(balance, np.append(np.zeros(count), 1.0), rcond=None)
    return np.asarray(found, np.float64)
