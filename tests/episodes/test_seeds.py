"""Seeds of episodes and random streams of policies."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.random import SeedSequence

from gamekeeper.errors import DrawError
from gamekeeper.randomness.seeds import episode_seed, policy_rng

numbers = st.integers(0, 2**80)
names = st.text(max_size=12)


def test_episode_seed_keeps_its_values() -> None:
    """A recorded run names only its run seed, so these values may never change."""
    assert [episode_seed(0, episode) for episode in (0, 1)] == [2044266242, 1790637272]
    assert episode_seed(2**64 + 7, 19) == 1960182699


def test_policy_rng_keeps_its_draws() -> None:
    """A policy that is played again draws what it drew when the run was recorded."""
    first, second = policy_rng(0, 0, "picker_0").random(2)
    assert (round(first, 8), round(second, 8)) == (0.51513464, 0.1104669)
    assert policy_rng(7, 3, "carrier_1").integers(10_000, size=3).tolist() == [7926, 7310, 4499]


@given(numbers, numbers)
def test_episode_seed_is_the_documented_word_of_seed_sequence(run_seed: int, episode: int) -> None:
    """Whoever reads the documentation can compute an episode's seed without Gamekeeper."""
    word = int(SeedSequence(run_seed, spawn_key=(0, episode)).generate_state(1, np.uint32)[0])
    assert word >> 1 == episode_seed(run_seed, episode)
    assert 0 <= episode_seed(run_seed, episode) < 2**31


def test_episode_seed_rarely_repeats_within_a_run() -> None:
    """Twenty thousand episodes of a run have almost as many seeds."""
    seeds = {episode_seed(3, episode) for episode in range(20_000)}
    assert len(seeds) > 19_990


@given(numbers, numbers, names, numbers, numbers, names)
def test_policy_rng_differs_wherever_its_arguments_do(
    run_a: int, episode_a: int, agent_a: str, run_b: int, episode_b: int, agent_b: str
) -> None:
    """Two streams are equal exactly where run, episode and agent are."""
    a = policy_rng(run_a, episode_a, agent_a).bit_generator.state
    b = policy_rng(run_b, episode_b, agent_b).bit_generator.state
    assert ((run_a, episode_a, agent_a) == (run_b, episode_b, agent_b)) == (a == b)


def test_policy_rng_is_no_function_of_the_environments_seed() -> None:
    """An agent's draws are not those of a generator seeded as the environment is."""
    seed = episode_seed(0, 0)
    env_draws = np.random.default_rng(seed).random(8).tolist()
    assert env_draws != policy_rng(0, 0, "a").random(8).tolist()
    assert env_draws != policy_rng(seed, 0, "a").random(8).tolist()


def test_policy_rng_draws_uniformly_over_agents_and_episodes() -> None:
    """First draws over many streams spread as draws of one stream do."""
    firsts = [
        policy_rng(0, episode, f"a_{i}").random() for episode in range(200) for i in range(20)
    ]
    counts = np.histogram(firsts, bins=10, range=(0, 1))[0]
    assert float(((counts - 400) ** 2 / 400).sum()) < 30  # chi square, 9 degrees: p = 0.0004


def test_seeds_leave_the_global_generator_alone() -> None:
    """Nobody else's random numbers change because a seed was derived."""
    np.random.seed(5)
    before = np.random.get_state()[1].tolist()
    episode_seed(1, 2)
    policy_rng(1, 2, "a").random()
    assert before == np.random.get_state()[1].tolist()


def test_seeds_take_numpys_whole_numbers() -> None:
    """A seed that comes out of an array is the same seed."""
    assert episode_seed(5, 1) == episode_seed(np.int64(5), np.uint8(1))  # type: ignore[arg-type]
    mine, theirs = policy_rng(5, 1, "a"), policy_rng(np.int64(5), np.uint8(1), "a")  # type: ignore[arg-type]
    assert mine.random() == theirs.random()


@pytest.mark.parametrize("wrong", [-1, 1.0, "0", None])
def test_seeds_refuse_what_is_no_whole_number_from_zero(wrong: object) -> None:
    """A wrong seed is named, whichever function it is given to."""
    with pytest.raises(DrawError, match="run_seed"):
        episode_seed(wrong, 0)  # type: ignore[arg-type]
    with pytest.raises(DrawError, match="episode"):
        policy_rng(0, wrong, "a")  # type: ignore[arg-type]
