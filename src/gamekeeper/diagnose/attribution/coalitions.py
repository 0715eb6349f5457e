"""Shapley values: what each player brings, over all orders in which a team could be put together.

Pure. A coalition is a whole number: bit i says that player i plays its own policy, else it plays
the baseline. Values are kept apart by episode, so that an interval over episodes can be given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import factorial
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MOST_EXACT: Final = 8
"""Players up to whom every coalition is played: 256 of them."""


def shapley_exact(values: FloatArray) -> FloatArray:
    """The Shapley values of a game whose every coalition is known.

    Args:
        values: [coalitions, episodes], coalition by its bits; all 2**n of them.
    Returns:
        [players, episodes]; they sum to the value of all minus that of none.
    Source: Shapley 1953, "A value for n-person games".
    """
    count = len(values)
    players = count.bit_length() - 1
    masks = np.arange(count)
    sizes = np.array([mask.bit_count() for mask in range(count)])
    shares = np.array([
        factorial(size) * factorial(players - size - 1) / factorial(players)
        for size in range(players)
    ])  # fmt: skip
    found = np.empty((players, values.shape[1]))
    for player in range(players):
        without = masks[(masks >> player) & 1 == 0]
        gains = values[without | 1 << player] - values[without]
        found[player] = shares[sizes[without]] @ gains
    return found


def orders(players: int, *, rng: Generator) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """A random order of the players and its reverse, which evens out the chance of the first."""
    drawn = tuple(rng.permutation(players).tolist())
    return drawn, drawn[::-1]


def prefixes(order: Sequence[int]) -> list[int]:
    """The coalitions of a team that is put together in this order, from none to all."""
    found = [0]
    for player in order:
        found.append(found[-1] | 1 << player)
    return found


def shapley_of_orders(
    played: Sequence[Sequence[int]], values: Mapping[int, float]
) -> NDArray[np.float64]:
    """What each player brought in one episode, on average over some orders.

    Its expectation over random orders is the Shapley value; it sums to the value of all minus that
    of none whatever the orders are.

    Args:
        played: the orders.
        values: of every coalition among their prefixes.
    Returns:
        [players].
    Source: Castro, Gomez & Tejada 2009, "Polynomial calculation of the Shapley value based on
        sampling"; Mitchell et al. 2022, "Sampling permutations for Shapley value estimation"
        (antithetic orders).
    """
    found = np.zeros(len(played[0]))
    for order in played:
        steps = prefixes(order)
        for player, before, after in zip(order, steps, steps[1:], strict=False):
            found[player] += values[after] - values[before]
    return found / len(played)


def everyone(players: int) -> int:
    """The coalition of all."""
    return (1 << players) - 1


def wanted(players: int, *, rng: Generator) -> tuple[list[int], tuple[tuple[int, ...], ...]]:
    """The coalitions to be played in one episode, and the orders where they are sampled.

    All of them up to `MOST_EXACT` players. Beyond that those of an order and its reverse, and
    everybody but one, for the difference rewards.
    """
    if players <= MOST_EXACT:
        return list(range(1 << players)), ()
    drawn = orders(players, rng=rng)
    whole = everyone(players)
    masks = {mask for order in drawn for mask in prefixes(order)}
    masks |= {whole & ~(1 << player) for player in range(players)}
    return sorted(masks), drawn
