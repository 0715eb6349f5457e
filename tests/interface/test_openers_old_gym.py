"""The old Gym's shape, both ways: its environments as ours, ours as its."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.errors import ActionError, EnvError, OrderError, SpecError
from gamekeeper.foreign.gym import OldGym
from gamekeeper.interface.old_gym import as_old_gym
from gamekeeper.interface.opening import open_env, reopen
from gamekeeper.runs.comparison import replay_evidence
from gamekeeper.runs.recording import rollout
from gamekeeper.tasks.two_robot_line import TwoRobotLine
from tests.interface.other_shapes import Lists, Solo

HERE = "gym:tests.interface.other_shapes:Lists"


def ended(env: Any) -> tuple[Any, ...]:
    """The last tick of an episode of zeros."""
    env.reset(seed=0)
    while env.agents:
        out = env.step(dict.fromkeys(env.agents, 0))
    return tuple(out)


def test_old_gym_lists_are_dealt_to_agents() -> None:
    """Observations, rewards and infos go by place, lists of numbers become declared arrays."""
    env = open_env(HERE).env
    seen, infos = env.reset(seed=5)
    assert infos == {"agent_0": {}, "agent_1": {}}
    assert np.float32 == seen["agent_0"].dtype
    seen, rewards, terminated, _, infos = env.step({"agent_0": 1, "agent_1": 2})
    assert (seen["agent_0"].tolist(), seen["agent_1"].tolist()) == ([1.0, 1.0], [2.0, 1.0])
    assert rewards == {"agent_0": 1.0, "agent_1": 2.0}
    assert infos == {"agent_0": {"place": 0}, "agent_1": {"place": 1}}
    assert not any(terminated.values())


def test_old_gym_seed_goes_through_env_seed() -> None:
    """The seed reaches `env.seed()` before the reset, its low 32 bits."""
    bare, env = Lists(), open_env(HERE).env
    bare.seed(7)
    expected = bare.reset()
    seen, _ = env.reset(seed=7 + (5 << 32))
    assert expected == [seen[agent].tolist() for agent in env.agents]


@pytest.mark.parametrize(("limited", "truncated"), [(False, False), (True, True)])
def test_old_gym_done_is_a_termination_unless_the_limit_is_told(
    limited: bool, truncated: bool
) -> None:
    """`TimeLimit.truncated` in the info makes a done a truncation; without it, it isn't guessed."""
    _, _, terminations, truncations, _ = ended(open_env(HERE, limited=limited).env)
    assert {not truncated} == set(terminations.values())
    assert {truncated} == set(truncations.values())


def test_old_gym_known_limit_is_a_truncation() -> None:
    """An environment that names its limit, as ma-gym's `_max_steps`, is truncated by it."""
    guest = Lists(most=3)
    guest._max_steps = 3  # type: ignore[attr-defined]
    env = OldGym(guest, name="limited")
    _, _, terminations, truncations, _ = ended(env)
    assert (any(terminations.values()), all(truncations.values())) == (False, True)
    assert env.endings["agent_1"] == "time limit"


def test_old_gym_of_one_agent_takes_its_action_alone() -> None:
    """Spaces that are no lists are of one agent."""
    env = OldGym(Solo(), name="solo")
    seen, rewards, terminated, _, _ = ended(env)
    assert (seen, rewards, terminated) == ({"agent_0": 4}, {"agent_0": 1.0}, {"agent_0": True})


def test_old_gym_rollout_replays() -> None:
    """Lists in and lists out replay bit for bit, nothing in them odd."""
    evidence = rollout(HERE, episodes=3, seed=2, env_kwargs={"agents": 3})
    assert replay_evidence(evidence, reopen(evidence.manifest["environment"])).verified
    assert not any(evidence.agent_steps["nonconforming"].to_pylist())


def test_old_gym_refuses_options_and_other_shapes() -> None:
    """Options would be lost, and what has no step is no environment."""
    with pytest.raises(SpecError, match="no options"):
        open_env(HERE).env.reset(options={"map": 1})
    with pytest.raises(SpecError, match="without reset, step"):
        open_env("gym:tests.interface.other_shapes:plain_jax")


@given(moves=st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=1, max_size=30))
def test_old_gym_there_and_back_changes_nothing(moves: list[tuple[int, int]]) -> None:
    """Ours offered in the old shape and opened from it again gives ours, tick by tick."""
    ours = TwoRobotLine(horizon=12)
    back = OldGym(as_old_gym(TwoRobotLine(horizon=12)), name="back")
    names = dict(zip(ours.possible_agents, back.possible_agents, strict=True))
    first, again = ours.reset(seed=1)[0], back.reset(seed=1)[0]
    for move in moves:
        for agent, name in names.items():
            np.testing.assert_array_equal(first[agent], again[name])
        if not ours.agents:
            break
        mine = ours.step(dict(zip(ours.possible_agents, move, strict=True)))
        theirs = back.step(dict(zip(back.possible_agents, move, strict=True)))
        first, again = mine[0], theirs[0]
        for agent, name in names.items():
            assert mine[1][agent] == theirs[1][name]
            assert mine[2][agent] == theirs[2][name]
            assert mine[3][agent] == theirs[3][name]
            assert mine[4][agent] == theirs[4][name]
        assert [names[agent] for agent in ours.agents] == back.agents


def test_as_old_gym_tells_both_kinds_of_end() -> None:
    """`done` is either; the info says of each agent, and of the episode, whether it was cut."""
    env = as_old_gym(open_env("two_robot_line", n=5, horizon=2).env)
    env.seed(0)
    env.reset()
    env.step([1, 1])
    _, rewards, dones, info = env.step([1, 1])
    assert (rewards, dones) == ([0.0, 0.0], [True, True])
    assert info["truncated"] == [True, True]
    assert info["TimeLimit.truncated"] is True
    with pytest.raises(OrderError):
        env.step([1, 1])
    env.reset()
    for _ in range(2):
        _, rewards, dones, info = env.step([2, 0])
    assert (rewards, dones) == ([1.0, 1.0], [True, True])
    assert info["TimeLimit.truncated"] is False


def test_as_old_gym_refuses_what_lists_cannot_hold() -> None:
    """A list of another length, a game of turns, and an episode that not everybody begins."""
    env = as_old_gym(open_env("two_robot_line").env)
    env.reset()
    with pytest.raises(ActionError, match="one action of each"):
        env.step([1])
    with pytest.raises(SpecError, match="parallel"):
        as_old_gym(open_env("classic/tictactoe_v3").env)
    env.agents.append("late")
    with pytest.raises(EnvError, match="begin with everybody"):
        env.reset()
