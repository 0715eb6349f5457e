"""Wrappers give what SuperSuit's give, where those hold; it comes with this trainer's packages."""

from __future__ import annotations

import numpy as np
import pytest

from gamekeeper.interface import wrappers
from tests.adapters.ledger import LedgerTicks

pytestmark = [
    pytest.mark.trainer,
    pytest.mark.filterwarnings("ignore"),  # SuperSuit's, of what it stands on
]


def pairs():
    """Ours, SuperSuit's, and the form of observations."""
    import supersuit

    return {
        "agent_id": ("Box", wrappers.agent_id, supersuit.agent_indicator_v0),
        "flatten": ("image", wrappers.flatten_observations, supersuit.flatten_v0),
        "clip_rewards": ("Box", wrappers.clip_rewards, supersuit.clip_reward_v0),
        "clip_actions": ("Box", wrappers.clip_actions, supersuit.clip_actions_v0),
        "frame_stack": (
            "Box",
            lambda env: wrappers.frame_stack(env, 3, padding="zeros"),
            lambda env: supersuit.frame_stack_v1(env, 3),
        ),
    }


@pytest.mark.parametrize(
    "name", ["agent_id", "flatten", "clip_rewards", "clip_actions", "frame_stack"]
)
def test_agents_are_given_what_supersuits_wrapper_gives(name: str) -> None:
    """One episode in Parallel: observations (as they are handed out), rewards and ends."""
    form, ours, theirs = pairs()[name]
    one, other = (wrap(LedgerTicks(seen=form, ends="one by one")) for wrap in (ours, theirs))
    (seen, _), (shown, _) = one.reset(seed=2), other.reset(seed=2)
    size = 3.0 if name == "clip_actions" else 1.0
    while one.agents:
        for agent in seen:
            if name == "agent_id":  # SuperSuit's number is the upper bound of the observations
                shown[agent][4:] /= 16
            np.testing.assert_array_equal(seen[agent], shown[agent])
        space = one.action_space(one.agents[0])
        action = np.full(space.shape, size, space.dtype) if space.shape else 1
        seen, *flags, _ = one.step(dict.fromkeys(one.agents, action))
        shown, *others, _ = other.step(dict.fromkeys(other.agents, action))
        assert flags == others
    assert not other.agents
