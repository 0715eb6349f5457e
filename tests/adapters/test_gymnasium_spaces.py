"""Gymnasium's forms hold every kind of space."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from gamekeeper.adapters.gymnasium import joint, single_agent, vector
from gamekeeper.errors import SpecError
from tests.adapters import kinds

BOTH = pytest.mark.parametrize("spec", [kinds.HERE, kinds.TURNS], ids=["parallel", "aec"])
EACH = pytest.mark.parametrize("kind", kinds.EACH, ids=kinds.name)


def drawn(space: Any, observation: Any, info: Any) -> Any:
    """An action that the mask allows, where there is one that allows any."""
    mask = info.get("action_mask")
    if mask is None and isinstance(observation, dict):
        mask = observation.get("action_mask")
    parts = mask if isinstance(mask, tuple) else (mask,)
    is_free = mask is None or not all(np.any(part) for part in parts)
    return space.sample() if is_free else space.sample(mask)


@BOTH
@EACH
def test_single_agent_plays_every_kind_of_space(kind: dict[str, Any], spec: str) -> None:
    """What it is shown is in its space, its legal actions are taken."""
    env = single_agent(spec, "dog_0", others="random", env_kwargs=kind)
    observation, info = env.reset(seed=0)
    env.action_space.seed(0)
    ends = 0
    for _ in range(30):
        assert env.observation_space.contains(observation)
        action = drawn(env.action_space, observation, info)
        observation, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            ends += 1
            observation, info = env.reset()
    assert ends
    env.close()


@EACH
def test_joint_plays_every_kind_of_space(kind: dict[str, Any]) -> None:
    """Everybody's observation by name, also of those who have ended."""
    env = joint(kinds.HERE, env_kwargs=kind)
    seen, told = env.reset(seed=0)
    env.action_space.seed(0)
    ends = 0
    for _ in range(30):
        assert env.observation_space.contains(seen)
        actions = {
            agent: drawn(space, seen[agent], told["infos"].get(agent, {}))
            for agent, space in env.action_space.spaces.items()
        }
        seen, _, terminated, truncated, told = env.step(actions)
        if terminated or truncated:
            ends += 1
            seen, told = env.reset()
    assert ends
    env.close()


@EACH
def test_vector_plays_every_kind_of_space(kind: dict[str, Any]) -> None:
    """Rows of those who are there are in the space; roles that see differently are refused."""
    if kind.get("roles") == 2:
        with pytest.raises(SpecError, match="not every agent"):
            vector(kinds.HERE, 2, env_kwargs=kind)
        return
    venv = vector(kinds.HERE, 2, env_kwargs=kind, absent="zeros")
    seen, told = venv.reset(seed=0)
    venv.action_space.seed(0)
    one = venv.single_observation_space
    for _ in range(20):
        for place in np.flatnonzero(told["live"]):
            assert one.contains(at(one, seen, place))
        masks = told.get("action_mask")
        actions = venv.action_space.sample() if masks is None else legal(venv, masks)
        seen, *_, told = venv.step(actions)
    venv.close()


def legal(venv: Any, masks: Any) -> Any:
    """The first legal action of each place."""
    space = venv.single_action_space
    if isinstance(space, spaces.Discrete):
        return masks.argmax(-1) + space.start
    parts = np.split(masks, np.cumsum(space.nvec)[:-1], axis=-1)
    return np.stack([part.argmax(-1) for part in parts], -1)


def at(space: Any, batch: Any, place: int) -> Any:
    """One place's value out of a batch."""
    if isinstance(space, spaces.Dict):
        return {key: at(part, batch[key], place) for key, part in space.spaces.items()}
    if isinstance(space, spaces.Tuple):
        return tuple(at(part, batch[i], place) for i, part in enumerate(space.spaces))
    return batch[place]
