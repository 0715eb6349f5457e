"""The foraging is lbforaging's, step by step: it runs on our random numbers beside it."""

import warnings

import numpy as np
import pytest

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from lbforaging.foraging import ForagingEnv

from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.foraging.foraging import Foraging

BIASED = [0.04, 0.14, 0.14, 0.14, 0.14, 0.4]
CASES = {
    "8x8": {},
    "coop": {"force_coop": True, "field_size": (5, 5), "max_num_food": 2, "sight": 2},
    "partial": {"players": 4, "field_size": (10, 10), "max_num_food": 5, "sight": 2},
    "penalty": {
        "players": 3,
        "field_size": (5, 5),
        "max_num_food": 2,
        "penalty": 0.1,
        "sight": 1,
        "max_player_level": 3,
    },
    "bounds": {
        "players": 3,
        "min_player_level": [1, 2, 3],
        "max_player_level": [1, 4, 3],
        "min_food_level": [1, 2, 5, 1],
        "max_food_level": [1, 4, 5, 3],
        "max_num_food": 4,
        "field_size": (9, 9),
        "normalize_reward": False,
        "observe_agent_levels": False,
        "sight": 3,
    },
    "crowd": {"players": 9, "field_size": (5, 5), "max_num_food": 4, "max_episode_steps": 90},
    "alone": {"players": 1, "field_size": (5, 5), "max_num_food": 9, "max_player_level": 1},
}


class Drawn:
    """Stands in for lbforaging's generator: the same choices, out of our stream."""

    def __init__(self, stream):
        self.stream = stream

    def integers(self, low, high):
        """As numpy's."""
        return self.stream.integers(int(low), int(high))

    def permutation(self, count):
        """As numpy's."""
        order = list(range(count))
        self.stream.shuffle(order)
        return np.array(order)


def reference_of(arguments):
    """The lbforaging environment of our arguments."""
    told = {
        "players": 2,
        "min_player_level": 1,
        "max_player_level": 2,
        "min_food_level": 1,
        "max_food_level": None,
        "field_size": (8, 8),
        "max_num_food": 3,
        "max_episode_steps": 50,
        "force_coop": False,
        **arguments,
    }
    return ForagingEnv(**{"sight": max(told["field_size"]), **told})


def compare(arguments, *, steps, seed):
    """Plays both; what was paid, and episodes that ended before their horizon."""
    ours, theirs = Foraging(**arguments, debug=True), reference_of(arguments)
    rng = np.random.default_rng(seed)
    agents, paid, cleared, episodes, begins = ours.possible_agents, 0.0, 0, 0, True
    for step in range(steps):
        if begins:
            begins, episodes = False, episodes + 1
            mine, _ = ours.reset(seed=seed + 1000 * episodes)
            theirs._np_random = Drawn(Stream(ours.rng.seed, ours.rng.episode))
            for player in theirs.players:
                player.position = None  # else it is in the way of who is put down before it
            seen, _ = theirs.reset()
        else:
            actions = rng.choice(6, len(agents), p=BIASED).tolist()
            mine, rewards, terminated, truncated, _ = ours.step(
                dict(zip(agents, actions, strict=True))
            )
            seen, expected, begins, _, _ = theirs.step(actions)
            assert expected == [rewards[agent] for agent in agents], step
            is_cleared = theirs.field.sum() == 0
            assert [bool(is_cleared)] * len(agents) == list(terminated.values()), step
            assert [bool(begins and not is_cleared)] * len(agents) == list(truncated.values())
            paid, cleared = paid + sum(expected), cleared + is_cleared
        np.testing.assert_array_equal(np.stack(seen), np.stack([mine[a] for a in agents]))
        assert ours.rng.draws == theirs._np_random.stream.draws
    return paid, cleared, episodes


@pytest.mark.parametrize("name", CASES)
def test_foraging_is_lbforaging_step_by_step(name):
    """Observations, rewards and ends are equal bit by bit, from the first state on."""
    paid, _, episodes = compare(CASES[name], steps=300, seed=len(name))
    assert paid != 0
    assert episodes > 4
