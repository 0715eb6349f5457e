"""Policies that bring agents together, on a field that is too wide for chance."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.auditing.meeting import MeetingPolicies, vector
from gamekeeper.interface.action_mask import reader

SPACE = Discrete(3)
WIDTH = 30


class _Random:
    def begin(self, run_seed: int, episode: int) -> None:
        self.rng = np.random.default_rng([run_seed, episode])

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        """Steps left, stays, or steps right."""
        return SPACE.dtype.type(self.rng.integers(3))


def _together(policies: Any, ticks: int = 400) -> int:
    """Ticks that two agents on a row of 30 cells spend on one cell, from its two ends on."""
    places, count = {"a": 0, "b": WIDTH - 1}, 0
    policies.begin(3, 0)
    for _ in range(ticks):
        for agent, place in list(places.items()):
            seen = np.array([place, 11], np.float32)
            step = int(policies.act(agent, seen, {})) - 1
            places[agent] = min(max(place + step, 0), WIDTH - 1)
        count += places["a"] == places["b"]
    return count


def test_agents_meet_more_often_than_by_chance() -> None:
    """What an action does is learned within the episode, and brings both to one cell."""
    meeting = MeetingPolicies(_Random(), lambda agent: SPACE, lambda agent: reader(None))
    assert _together(_Random()) < 60 < _together(meeting)


def test_masks_are_obeyed_on_the_way() -> None:
    """An action that the mask forbids is left to the usual policy."""
    base = _Random()
    base.act = lambda agent, observation, info: np.int64(1)  # type: ignore[method-assign]  # stub
    policies = MeetingPolicies(base, lambda agent: SPACE, lambda agent: reader(None))
    policies.begin(0, 0)
    mask = np.array([0, 1, 0], np.int8)
    done = {
        int(policies.act(agent, np.array([k % 7.0]), {"action_mask": mask}))
        for k in range(100)
        for agent in ("a", "b")
    }
    assert done == {1}


def test_pictures_and_nested_observations_are_read() -> None:
    """Numbers of nested values stand in a row, without masks; pictures are left out."""
    seen = {"b": (1, np.array([2.0, 3.0])), "a": 0, "action_mask": np.ones(3)}
    assert vector(seen).tolist() == [0.0, 1.0, 2.0, 3.0]
    assert len(vector(np.zeros((64, 64, 3)))) == 0
