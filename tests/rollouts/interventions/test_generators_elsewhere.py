"""An environment's own generators, moved elsewhere once a reset has begun them."""

import random
from typing import Any

import numpy as np

from gamekeeper.episodes.divergence import compare
from gamekeeper.rollouts.episode_loop import EpisodePlan, perform
from gamekeeper.rollouts.interventions.generator_futures import GeneratorsElsewhere
from gamekeeper.rollouts.process_randomness import standing
from gamekeeper.runs.recording import joint_policy_of
from tests.faults.rovers import Rovers

OWN = 2
"""Place of the first generator of the environment's own."""


def played(places: tuple[int, ...]) -> Any:
    """An episode of the same actions, its generators at these places moved."""
    env = Rovers()
    base = perform(
        EpisodePlan(seed=1, most_turns=8), env, joint_policy=joint_policy_of("random", env, None)
    )
    change = GeneratorsElsewhere(places, number=5)
    return compare(base.episode, perform(base.play, Rovers(), change=change).episode).divergence


def test_generators_elsewhere_change_the_play_that_draws_from_them() -> None:
    """The reset is the same one; what is drawn later is not."""
    divergence = played((OWN,))

    assert divergence is not None
    assert divergence.turn > 0 or divergence.field.startswith("reward")


def test_generators_elsewhere_leave_the_others_alone() -> None:
    """A place where no generator of its own stands changes nothing, nor do the shared ones."""
    before = random.getstate(), np.random.get_state(legacy=False)["state"]["pos"]

    assert played((0, 1, OWN + 9)) is None
    assert before == (random.getstate(), np.random.get_state(legacy=False)["state"]["pos"])


def test_standing_tells_no_place_of_the_systems_entropy() -> None:
    """Who can't be asked stands nowhere, and stops nobody."""
    env = Rovers()
    env.reset(seed=3)
    env.entropy = random.SystemRandom()

    assert standing(env).count(None) == 1


def test_standing_tells_where_a_reset_begins() -> None:
    """Equal seeds begin at one place, others elsewhere."""
    stands = []
    for seed in (3, 3, 4):
        env = Rovers()
        env.reset(seed=seed)
        stands.append(repr(standing(env)[OWN]))

    assert stands[0] == stands[1] != stands[2]
