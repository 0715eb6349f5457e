"""Shapley values: equal to brute force, and their laws."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gamekeeper.diagnosis.attribution.agent_measures import (
    MOST_EXACT,
    everyone,
    prefixes,
    shapley_exact,
    shapley_of_orders,
    wanted,
)

GAMES = st.integers(1, 5).flatmap(
    lambda n: arrays(np.float64, (2**n, 3), elements=st.floats(-100, 100, width=32))
)


def brute_force(values: np.ndarray) -> np.ndarray:
    """What each player adds on average over every order in which a team can be put together."""
    players = len(values).bit_length() - 1
    found = np.zeros((players, values.shape[1]))
    every = list(permutations(range(players)))
    for order in every:
        mask = 0
        for player in order:
            found[player] += values[mask | 1 << player] - values[mask]
            mask |= 1 << player
    return found / len(every)


@given(GAMES)
def test_shapley_equals_brute_force(values) -> None:
    """The weighted sum over coalitions is the mean over all orders."""
    np.testing.assert_allclose(shapley_exact(values), brute_force(values), atol=1e-9)


@given(GAMES)
def test_shapley_sums_to_what_all_bring(values) -> None:
    """Nothing is lost and nothing is added, in every episode."""
    total = shapley_exact(values).sum(axis=0)
    np.testing.assert_allclose(total, values[-1] - values[0], atol=1e-9)


@given(GAMES, st.integers(0, 4))
def test_shapley_of_a_dummy_is_what_it_brings_alone(values, player) -> None:
    """A player that adds the same to every coalition gets just that."""
    players = len(values).bit_length() - 1
    player %= players
    masks = np.arange(len(values))
    without = values[masks & ~(1 << player)]
    game = without + 7.0 * ((masks >> player) & 1)[:, None]
    np.testing.assert_allclose(shapley_exact(game)[player], 7.0, atol=1e-9)


@given(GAMES)
def test_shapley_of_all_orders_is_exact(values) -> None:
    """Sampling every order once leaves nothing to chance."""
    players = len(values).bit_length() - 1
    one = dict(enumerate(values[:, 0].tolist()))
    sampled = shapley_of_orders(list(permutations(range(players))), one)
    np.testing.assert_allclose(sampled, shapley_exact(values)[:, 0], atol=1e-9)


@given(st.integers(9, 20), st.integers(0, 1000))
def test_sampled_shapley_sums_to_what_all_bring(players, seed) -> None:
    """Whatever the orders are, their marginal values add up to all less none."""
    rng = np.random.default_rng(seed)
    masks, drawn = wanted(players, rng=rng)
    values = dict(zip(masks, rng.normal(size=len(masks)).tolist(), strict=True))
    total = shapley_of_orders(drawn, values).sum()
    assert total == pytest.approx(values[everyone(players)] - values[0])


def test_wanted_has_every_coalition_of_few_players() -> None:
    """Up to eight players nothing is sampled."""
    assert MOST_EXACT == 8
    masks, drawn = wanted(8, rng=np.random.default_rng(0))
    assert (masks, drawn) == (list(range(256)), ())


@given(st.integers(9, 16))
def test_wanted_has_everybody_but_one(players) -> None:
    """Difference rewards come from the same episodes."""
    masks, _ = wanted(players, rng=np.random.default_rng(0))
    assert {everyone(players) & ~(1 << k) for k in range(players)} <= set(masks)


def test_orders_are_a_draw_and_its_reverse() -> None:
    """Antithetic: who comes first in one comes last in the other."""
    _, (one, two) = wanted(9, rng=np.random.default_rng(1))
    assert (one, sorted(one)) == (two[::-1], list(range(9)))
    assert [mask.bit_count() for mask in prefixes(one)] == list(range(10))
