"""One copy of a kernel as PettingZoo has it plays as a batch of one does, and can be copied."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.kernel_env import kernel_env
from gamekeeper.randomness.seeds import EpisodeSeeds
from gamekeeper.tasks.two_robot_line import TwoRobotLine
from tests.kernels.lines import WINDY


def played(env: Any, actions: Any) -> list[Any]:
    """What the steps give, as plain data."""
    found = []
    for row in actions:
        if not env.agents:
            env.reset()
        pairs = zip(env.possible_agents, row.tolist(), strict=True)
        told = env.step({agent: action for agent, action in pairs if agent in env.agents})
        found.append([{a: np.asarray(v).tolist() for a, v in part.items()} for part in told[:4]])
    return found


def drawn(steps: int, seed: int = 0) -> Any:
    """Actions from a fixed stream, of two agents."""
    return np.random.default_rng(seed).integers(0, 3, (steps, 2))


@pytest.mark.parametrize("debug", [False, True])
def test_face_plays_as_a_batch_of_one_does(debug: bool) -> None:
    """The same observations, rewards and ends, agent by agent, over many episodes."""
    env, seeds, number = kernel_env(WINDY, debug=debug), EpisodeSeeds(3), 0
    batch = Batch(WINDY, 1, seed=3, infos=True, autoreset="next_step", debug=debug)
    batch.reset()
    env.reset(seed=seeds[0])
    for row in drawn(300):
        if batch.arrays.over[0]:
            number += 1
            env.reset(seed=seeds[number])
            batch.step(row[None])
            continue
        agents = list(env.agents)
        obs, paid, terminated, truncated, _ = env.step(
            {agent: int(row[env.number_of[agent]]) for agent in agents}
        )
        a = batch.arrays
        batch.step(row[None])
        for agent in agents:
            i = env.number_of[agent]
            assert paid[agent] == a.rewards[0, i]
            assert (terminated[agent], truncated[agent]) == (a.terminated[0, i], a.truncated[0, i])
            assert np.array_equal(obs[agent], a.obs[0, i])
    assert number > 5


@pytest.mark.parametrize("debug", [False, True])
@pytest.mark.parametrize("how", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copy_goes_on_alone(debug: bool, how: Any) -> None:
    """What a copy plays is what the original plays, and neither touches the other."""
    env = TwoRobotLine(debug=debug)
    env.reset(seed=5)
    played(env, drawn(40))  # some were paid
    other = how(env)
    state = env.state()
    theirs = played(other, drawn(60, seed=1))
    assert np.array_equal(state, env.state())
    assert theirs == played(env, drawn(60, seed=1))


@pytest.mark.parametrize("debug", [False, True])
def test_snapshot_goes_on_as_often_as_wanted(debug: bool) -> None:
    """Restored, also into another instance, an environment plays what it played."""
    env, other = TwoRobotLine(debug=debug), TwoRobotLine(debug=debug)
    env.reset(seed=5)
    other.reset(seed=6)
    played(env, drawn(40))
    snapshot = env.snapshot()
    first = played(env, drawn(60, seed=1))
    for each in (env, other):
        each.restore(snapshot)
        assert first == played(each, drawn(60, seed=1))


def test_debugged_face_plays_as_the_compiled_one() -> None:
    """Compiled or plain, the same."""
    runs = []
    for debug in (False, True):
        env = kernel_env(WINDY, debug=debug)
        env.reset(seed=9)
        runs.append(played(env, drawn(200)))
    assert runs[0] == runs[1]
