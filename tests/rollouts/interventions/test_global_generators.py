"""The generators of the whole process: held, disturbed, restored."""

import random

import numpy as np

from gamekeeper.rollouts.episode_loop import EpisodePlan, perform
from gamekeeper.rollouts.interventions.generator_futures import GlobalGeneratorsDisturbed
from gamekeeper.rollouts.process_randomness import held, states
from gamekeeper.runs.recording import joint_policy_of
from tests.faults.rovers import Rovers


def test_held_starts_from_one_seed_and_leaves_no_trace() -> None:
    """Two times within it draw alike, and nobody outside notices."""
    before = states()
    drawn = []
    for _ in range(2):
        with held():
            drawn.append((random.random(), np.random.rand()))

    assert drawn[0] == drawn[1]
    assert before == states()


def test_disturbed_generators_are_put_back_after_the_play() -> None:
    """An episode disturbs them between all turns and leaves them as they were."""
    env, seen = Rovers(), []
    before = states()
    perform(
        EpisodePlan(seed=1, most_turns=3),
        env,
        joint_policy=joint_policy_of("random", env, None),
        change=GlobalGeneratorsDisturbed(),
        watch=lambda turn, env, out: seen.append(np.random.get_state(legacy=True)[1][0]),
    )

    assert len(set(seen)) == 4
    assert before == states()
