"""Advantages run over an agent's own decisions, and are the usual ones where it always acts."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.adapters.decisions import decided

GAMMA, TRACE = 0.9, 0.8


def usual(rewards: Any, values: Any, ends: Any, last: Any) -> Any:
    """Generalised advantage estimation as every textbook has it, one slot."""
    advantages, carried = np.zeros(len(rewards)), 0.0
    for step in reversed(range(len(rewards))):
        following = last if step == len(rewards) - 1 else values[step + 1]
        goes_on = 1.0 - ends[step]
        delta = rewards[step] + GAMMA * following * goes_on - values[step]
        carried = delta + GAMMA * TRACE * goes_on * carried
        advantages[step] = carried
    return advantages


def drawn(seed: int, steps: int) -> tuple[Any, Any, Any, float]:
    """Rewards, values, ends of one slot, and the value after the last step."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=steps), rng.normal(size=steps), rng.random(steps) < 0.2, rng.normal()


@given(st.integers(0, 2**32), st.integers(1, 12))
def test_decided_is_the_usual_estimate_where_everybody_acts(seed: int, steps: int) -> None:
    """No waiting, no difference."""
    rewards, values, ends, last = drawn(seed, steps)
    acted = np.ones((steps, 1), bool)
    found, valid = decided(
        rewards[:, None],
        values[:, None],
        acted,
        ends[:, None],
        np.array([last]),
        np.array([True]),
        gamma=GAMMA,
        gae_lambda=TRACE,
    )
    assert valid.all()
    np.testing.assert_allclose(usual(rewards, values, ends, last), found[:, 0], atol=1e-12)


@given(st.integers(0, 2**32), st.lists(st.booleans(), min_size=1, max_size=14))
def test_decided_gives_a_reward_to_the_last_action(seed: int, acts: list[bool]) -> None:
    """Waiting steps squeezed out, their rewards added to the decision before: the same numbers."""
    rewards, values, _, last = drawn(seed, len(acts))
    acted, ends = np.array(acts), np.zeros(len(acts), bool)
    found, valid = decided(
        rewards[:, None],
        values[:, None],
        acted[:, None],
        ends[:, None],
        np.array([last]),
        np.array([True]),
        gamma=GAMMA,
        gae_lambda=TRACE,
    )
    places = np.flatnonzero(acted)
    bounds = [*places.tolist(), len(acts)]
    sums = [rewards[a:b].sum() for a, b in itertools.pairwise(bounds)]
    expected = usual(np.array(sums), values[places], ends[places], last) if sums else []
    assert valid[:, 0].tolist() == acts
    np.testing.assert_allclose(expected, found[places, 0], atol=1e-12)


def test_decided_leaves_out_what_is_still_open() -> None:
    """Who waits as the rollout ends has a last decision without an outcome yet."""
    acted = np.array([[True], [True], [False]])
    zeros = np.zeros((3, 1))
    _, valid = decided(
        zeros,
        zeros,
        acted,
        zeros.astype(bool),
        np.zeros(1),
        np.array([False]),
        gamma=GAMMA,
        gae_lambda=TRACE,
    )
    assert valid[:, 0].tolist() == [True, False, False]


def test_decided_pays_an_end_while_waiting_to_the_last_action() -> None:
    """The other one's winning move ends the game for who waits, and it is paid for it."""
    rewards, values = np.array([[0.0], [-1.0], [0.0]]), np.zeros((3, 1))
    acted, ends = np.array([[True], [False], [True]]), np.array([[False], [True], [False]])
    found, valid = decided(
        rewards,
        values,
        acted,
        ends,
        np.array([5.0]),
        np.array([True]),
        gamma=GAMMA,
        gae_lambda=TRACE,
    )
    assert found[0, 0] == -1.0
    assert valid[:, 0].tolist() == [True, False, True]
