"""Policies for the foraging task, out of what a player sees (with levels, without a grid)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

NOTHING, NORTH, SOUTH, WEST, EAST, LOAD = range(6)


def reference(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """All go to the food that lies nearest to all of them together, and load it."""
    foods, players = _seen(observation, int(info["foods"]))
    if not len(foods):
        return int(rng.integers(NORTH, LOAD))
    distance = np.abs(foods[:, None, :2] - players[None, :, :2]).sum(axis=(1, 2))
    return _towards(foods[int(distance.argmin())], players, rng)


def greedy(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Goes to the food that lies nearest to itself, strong enough for it or not."""
    foods, players = _seen(observation, int(info["foods"]))
    if not len(foods):
        return int(rng.integers(NORTH, LOAD))
    distance = np.abs(foods[:, :2] - players[0, :2]).sum(axis=1)
    return _towards(foods[int(distance.argmin())], players, rng)


def lazy(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Does nothing."""
    return NOTHING


def _seen(
    observation: NDArray[np.float32], count: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(row, column, level) of food and of players, without what isn't seen; oneself first."""
    rows = observation.reshape(-1, 3)
    foods, players = rows[:count], rows[count:]
    return foods[foods[:, 2] > 0], players[players[:, 2] > 0]


def _towards(food: NDArray[np.float32], players: NDArray[np.float32], rng: Generator) -> int:
    """A step to the side of the food; around others with a random step now and then."""
    down, right = (food - players[0])[:2]
    if abs(down) + abs(right) == 1:
        return LOAD
    if rng.random() < 0.15:
        return int(rng.integers(NORTH, LOAD))
    if abs(down) > abs(right):
        return SOUTH if down > 0 else NORTH
    return EAST if right > 0 else WEST
