"""Wrappers give what Gymnasium's own give, where an environment has one agent."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers as theirs

import gamekeeper as gk
from gamekeeper.interface import wrappers as ours

AGENT = "agent_0"


class Drift(gymnasium.Env):
    """Adds actions up until they are more than 3; pays what was added, twice."""

    observation_space = gymnasium.spaces.Box(-9, 9, (2, 3), np.float32)
    action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.place = np.full((2, 3), self.np_random.uniform(), np.float32)
        return self.place.copy(), {}

    def step(self, action: Any) -> Any:
        self.place += action * np.arange(6, dtype=np.float32).reshape(2, 3) / 5
        return self.place.copy(), float(2 * action[0]), bool(self.place.max() > 3), False, {}


PAIRS: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "frame_stack": (
        lambda env: ours.frame_stack(env, 3),
        lambda env: theirs.FrameStackObservation(env, 3),
    ),
    "frame_stack of zeros": (
        lambda env: ours.frame_stack(env, 3, padding="zeros"),
        lambda env: theirs.FrameStackObservation(env, 3, padding_type="zero"),
    ),
    "flatten": (ours.flatten_observations, theirs.FlattenObservation),
    "clip_rewards": (
        lambda env: ours.clip_rewards(env, -1, 1),
        lambda env: theirs.ClipReward(env, -1, 1),
    ),
    "clip_actions": (ours.clip_actions, theirs.ClipAction),
    "time_limit": (lambda env: ours.time_limit(env, 4), lambda env: theirs.TimeLimit(env, 4)),
}


@pytest.mark.parametrize("name", PAIRS)
def test_one_agent_is_given_what_gymnasiums_wrapper_gives(name: str) -> None:
    """Observations, rewards and both ends of an episode; Gymnasium stacks in a first axis."""
    our, their = PAIRS[name]
    one, other = our(gk.make(Drift())), their(Drift())
    actions = [np.array([size], np.float32) for size in (0.5, -0.25, 1.0, 1.0, 1.0, 1.0)]
    if name == "clip_actions":
        actions = [3 * action for action in actions]
    (seen, _), (shown, _) = one.reset(seed=1), other.reset(seed=1)
    for action in actions:
        expected = np.moveaxis(shown, 0, -1) if name.startswith("frame_stack") else shown
        np.testing.assert_array_equal(seen[AGENT], expected)
        seen, paid, ended, cut, _ = one.step({AGENT: action})
        shown, reward, terminated, truncated, _ = other.step(action)
        assert (paid[AGENT], ended[AGENT], cut[AGENT]) == (reward, terminated, truncated)
        if terminated or truncated:
            break
    assert not one.agents


def test_normalized_observations_are_gymnasiums() -> None:
    """Statistics are those of the same decisions; Gymnasium's count the last observation too."""
    found = ours.Statistics()
    one = ours.normalize(gk.make(Drift()), found, learning=True, rewards=False)
    other = theirs.NormalizeObservation(Drift())
    one.reset(seed=1)
    other.reset(seed=1)
    for size in (0.5, -0.25, 1.0):
        one.step({AGENT: np.array([size], np.float32)})
        statistics = found.of(AGENT).parts[""]
        np.testing.assert_allclose(statistics[0], other.obs_rms.mean, rtol=1e-6)
        np.testing.assert_allclose(statistics[1], other.obs_rms.var, rtol=1e-5, atol=1e-9)
        other.step(np.array([size], np.float32))
