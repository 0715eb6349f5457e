"""Worlds of particles are mpe2's: the same observations, rewards, ends and states."""

from typing import Any

import pytest

from tests.tasks.particle_worlds import PAIRS, differences

SOME = [
    ("spread", {}),
    ("spread", {"N": 1, "local_ratio": 1.0}),
    ("spread", {"N": 6, "crowd": 0.4}),
    ("spread", {"N": 5, "continuous_actions": True, "local_ratio": 0.3, "max_cycles": 60}),
    ("spread", {"N": 4, "num_agent_neighbors": 2, "num_landmark_neighbors": 3}),
    ("spread", {"N": 2, "num_agent_neighbors": 3, "num_landmark_neighbors": 4}),
    ("spread", {"N": 3, "curriculum": True, "crowd": 0.3}),
    ("spread", {"N": 1, "terminate_on_success": True, "max_cycles": 80}),
    ("tag", {}),
    ("tag", {"num_good": 3, "num_adversaries": 4, "num_obstacles": 3, "crowd": 0.4}),
    ("tag", {"num_good": 2, "num_obstacles": 0, "continuous_actions": True, "max_cycles": 60}),
    ("tag", {"num_good": 2, "num_agent_neighbors": 3, "num_landmark_neighbors": 1}),
    ("tag", {"num_good": 2, "num_agent_neighbors": 6, "num_landmark_neighbors": 4}),
    ("tag", {"num_landmark_neighbors": 1, "curriculum": True}),
    ("tag", {"terminate_on_success": True, "crowd": 0.3}),
    ("reference", {}),
    ("reference", {"continuous_actions": True, "local_ratio": 0.2, "max_cycles": 40}),
    ("speaker_listener", {}),
    ("speaker_listener", {"continuous_actions": True, "max_cycles": 40}),
]
NAMES = [f"{name} {' '.join(map(str, given.values()))}".strip() for name, given in SOME]
SEEN = 1e-17
"""mpe2's bodies push each other from any distance, however little."""
REWARDS = 1e-12
"""A reward of three terms is summed term by term, which may change its last digit."""


@pytest.mark.parametrize(("name", "given"), SOME, ids=NAMES)
def test_particles_are_those_of_mpe2(name: str, given: dict[str, Any]) -> None:
    """From the same state, with the same actions, plain Python: observations but for nothing."""
    seen, paid = differences(name, steps=120, seed=3, debug=True, **given)
    assert seen < SEEN
    assert paid < REWARDS


@pytest.mark.parametrize("number", [0, 8, 15, 18], ids=lambda number: NAMES[number])
def test_compiled_particles_are_those_of_mpe2(number: int) -> None:
    """The same for 2,000 steps of compiled rules, from two seeds."""
    name, given = SOME[number]
    for seed in range(2):
        seen, paid = differences(name, steps=1_000, seed=seed, debug=False, **given)
        assert seen < SEEN
        assert paid < REWARDS


def test_every_task_is_compared() -> None:
    """No task is without its reference."""
    assert set(PAIRS) == {name for name, _ in SOME}
