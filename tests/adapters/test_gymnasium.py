"""Gymnasium's faces: one agent, all agents, and what they say of ends and seeds."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gamekeeper as gk
from gamekeeper.adapters.gymnasium import joint, single_agent
from gamekeeper.errors import SpecError

SPREAD = "mpe2.simple_spread_v3:parallel_env"


@pytest.mark.parametrize("spec", ["two_robot_line", "handover"])
def test_single_agent_passes_gymnasiums_check(spec: str) -> None:
    """Seeds, spaces, types: all that `check_env` looks at, of Parallel and of AEC."""
    agent = gk.make(spec).possible_agents[0]
    env = single_agent(spec, agent, others="noop")
    mask = "action_mask" in env.reset(seed=0)[1]
    if not mask:
        check_env(env, skip_render_check=True)
    env.close()


def test_single_agent_is_paid_as_a_rollout_pays_it() -> None:
    """The same seed, policies and episode give the same rewards, decision by decision."""
    played = gk.rollout("two_robot_line", policies="greedy", episodes=1, seed=3)
    rows = played.steps.to_pylist()
    own = [row["reward"] for row in rows if row["agent"] == "picker" and row["order"] is not None]
    seed = int(played.episodes.to_pylist()[0]["seed"])

    env = single_agent("two_robot_line", "picker", others={"carrier": "greedy"})
    env.reset(seed=seed)
    paid, is_over = [], False
    while not is_over:
        _, reward, terminated, truncated, _ = env.step(2)
        paid.append(reward)
        is_over = terminated or truncated
    assert own == paid


def test_single_agent_names_who_has_no_policy() -> None:
    """Nobody is played by chance without being told."""
    with pytest.raises(SpecError, match="no policy"):
        single_agent("two_robot_line", "picker")


def test_single_agent_of_turns_is_paid_for_all_between_two_decisions() -> None:
    """What the other's turns pay an agent comes with its own next observation."""
    env = single_agent("handover", "giver_0", others="reference")
    observation, info = env.reset(seed=0)
    total, is_over = 0.0, False
    while not is_over:
        action = int(np.flatnonzero(info["action_mask"])[-1])
        observation, reward, terminated, truncated, info = env.step(action)
        total += reward
        is_over = terminated or truncated
    assert env.observation_space.contains(observation)
    assert np.isfinite(total)


def test_joint_shows_everybody_and_sums_rewards() -> None:
    """The sum is the reward, its parts stand in the info."""
    env = joint(SPREAD)
    with pytest.warns(UserWarning, match="infinity"):  # Gymnasium's, of mpe2's bounds
        check_env(env, skip_render_check=True)
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(25):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert sum(info["rewards"].values()) == pytest.approx(reward, abs=0)
    assert (terminated, truncated) == (False, True)
    assert set(observation) == set(map(str, env.agents))


def test_joint_refuses_turns() -> None:
    """An AEC environment has no joint action."""
    with pytest.raises(SpecError, match="no joint action"):
        joint("handover")


def test_joint_may_see_the_state() -> None:
    """A centralised controller is shown what `state()` gives."""
    env = joint("two_robot_line", observe="state")
    state, _ = env.reset(seed=0)
    assert np.asarray(state).tolist() == [0, 4]
