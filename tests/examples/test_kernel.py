"""The first kernel: its rules, its environments, and the batch."""

from __future__ import annotations

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from examples.kernel import CELLS, CHARGE, RING, ROBOTS, main
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.kernel_env import kernel_env
from gamekeeper.kernels.scalar_rules import numba

DOWN, STAY, UP = range(3)


def started(seed: int = 0):
    """A copy in plain Python, at the start of an episode."""
    env = kernel_env(RING, debug=True)
    env.reset(seed=seed)
    return env


def test_ring_conforms_to_pettingzoo(capsys):
    """PettingZoo's own test passes."""
    parallel_api_test(started(), num_cycles=200)
    capsys.readouterr()


def test_ring_robots_begin_evenly_apart():
    """R1: and the parcel is drawn with the seed."""
    env = started()
    assert env.memory.records["cell"][0].tolist() == [0, 4, 8]
    assert len({int(started(seed).memory.records["parcel"][0]) for seed in range(20)}) > 5


def test_ring_moves_round_and_costs_battery():
    """R2: below 0 comes the last cell; who stays spends nothing."""
    env = started()
    env.memory.records["parcel"][0] = 6
    seen, *_ = env.step({"robot_0": DOWN, "robot_1": UP, "robot_2": STAY})
    assert [seen[a][0] for a in env.agents] == [CELLS - 1, 5, 8]
    assert [seen[a][2] for a in env.agents] == [CHARGE - 1, CHARGE - 1, CHARGE]


def test_ring_shares_a_parcel():
    """R3: among who is in its cell."""
    env = started()
    env.memory.records["parcel"][0], env.memory.records["cell"][0] = 5, [4, 6, 9]
    _, rewards, *_ = env.step({"robot_0": UP, "robot_1": DOWN, "robot_2": STAY})
    assert rewards == {"robot_0": 0.5, "robot_1": 0.5, "robot_2": 0.0}


def test_ring_ends_robots_one_by_one():
    """R4: an empty battery truncates a robot alone, the horizon the others."""
    env = started()
    while env.agents:
        env.step({agent: STAY if agent == "robot_1" else UP for agent in env.agents})
    assert env.endings == {"robot_0": "empty", "robot_1": "horizon", "robot_2": "empty"}
    assert env.turns == 100


@pytest.mark.skipif(numba() is None, reason="Numba, the extra `fast`, isn't installed")
def test_ring_compiled_equals_plain():
    """Bit for bit, over several episodes."""
    batches = [Batch(RING, 4, seed=1, debug=debug) for debug in (True, False)]
    rng = np.random.default_rng(0)
    for batch in batches:
        batch.reset()
    for _ in range(150):
        actions = rng.integers(0, 3, (4, ROBOTS))
        for batch in batches:
            batch.step(actions)
        assert batches[0].snapshot() == batches[1].snapshot()
        assert np.array_equal(batches[0].arrays.obs, batches[1].arrays.obs)
        assert np.array_equal(batches[0].arrays.rewards, batches[1].arrays.rewards)


def test_ring_example_says_what_it_played(capsys):
    """Its two lines."""
    main()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("one copy: ")
    assert lines[1].startswith("1,024 copies: ")
