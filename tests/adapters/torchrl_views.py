"""What a recorded episode is through TorchRL's eyes, row by row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

TAG = "mpe2.simple_tag_v3:parallel_env"
FOUR = "pettingzoo.classic.connect_four_v3:env"
LATE = f"{Path(__file__).with_name('late_joins.py')}:Late"
LEAVES = f"{Path(__file__).parents[1] / 'vector' / 'worlds.py'}:Leaves"
LEAKY = f"{Path(__file__).with_name('late_joins.py')}:Leaky"


def made(spec: object, num_envs: int | None = 2, **options: Any) -> Any:
    """Without an audit, which has a test of its own."""
    from gamekeeper.adapters import torchrl

    return torchrl.env(spec, num_envs, check=None, **options)


def first_legal(env: Any) -> Any:
    """A policy: the first action that the mask allows; the last of all where there is none."""

    def act(tensordict: Any) -> Any:
        for group in env.group_map:
            spec = env.full_action_spec[group, "action"]
            mask = tensordict.get((group, "action_mask"), None)
            last = spec.zero() + (spec.space.n - 1)
            tensordict[group, "action"] = last if mask is None else mask.to(int).argmax(-1)
        return tensordict

    return act


class Same:
    """The same, one agent at a time."""

    def __init__(self, n: int) -> None:
        self.n = n

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        mask = info.get("action_mask")
        if isinstance(observation, dict):
            mask = observation.get("action_mask", mask)
        return self.n - 1 if mask is None else int(np.argmax(mask))


def bare(observation: Any) -> Any:
    """An observation without its mask."""
    return observation["observation"] if isinstance(observation, dict) else observation


def compare(own: Any, after: Any, episode: Any, agent: str) -> None:
    """A stream of one agent's steps holds what its rows do, its last observation too."""
    given = [turn for turn in episode.turns if agent in turn.cumulative_reward]
    if not given:  # a spare that nobody needed
        return
    acts = [turn for turn in given if turn.actions.get(agent) is not None]
    end = int(np.flatnonzero(after["done"][:, 0].numpy())[0])
    steps = np.flatnonzero(own["mask"].numpy()[: end + 1])
    assert len(acts) == len(steps)
    for turn, step in zip(acts, steps, strict=True):
        np.testing.assert_array_equal(
            bare(turn.observations[agent]), own["observation"][step].numpy()
        )
        assert int(turn.actions[agent]) == int(own["action"][step])
    paid = sum(float(turn.rewards.get(agent, 0.0)) for turn in episode.turns)
    assert float(after["reward"][: end + 1].sum()) == pytest.approx(paid, abs=1e-4)
    flags = [
        (row["terminated"], row["truncated"])
        for row in episode.steps.to_pylist()
        if row["agent"] == agent and (row["terminated"] or row["truncated"])
    ]
    assert flags[0] == (bool(after["terminated"][end]), bool(after["truncated"][end]))
    np.testing.assert_array_equal(
        bare(given[-1].observations[agent]), after["observation"][end].numpy()
    )
