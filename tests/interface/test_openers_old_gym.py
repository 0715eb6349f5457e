"""The old Gym's environments as ours."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gamekeeper.errors import SpecError
from gamekeeper.foreign.gym import OldGym
from gamekeeper.interface.opening import open_env, reopen
from gamekeeper.runs.comparison import replay_evidence
from gamekeeper.runs.recording import rollout
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
