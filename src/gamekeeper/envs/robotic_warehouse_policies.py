"""Policies for the robotic warehouse, out of what a robot senses next to it and of its info."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.envs.robotic_warehouse_floor import OWN, SENSED

NOOP, FORWARD, LEFT, RIGHT, TOGGLE = range(5)
UP, DOWN, WEST, EAST = range(4)
CLOCKWISE = (UP, EAST, DOWN, WEST)
RESTLESS: Final = 0.05
"""How often the reference does anything at all: who stood before each other come apart."""
PATIENCE: Final = 0.3
"""How likely it waits a tick for a robot ahead, and doesn't go round it."""


def reference(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Fetches the nearest requested shelf, delivers it and puts it back; makes room for others."""
    if rng.random() < RESTLESS:
        return int(rng.integers(FORWARD, TOGGLE))
    return _fetch(observation, info, rng, patience=PATIENCE)


def greedy(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """As the reference, straight on: robots that meet stand before each other for good."""
    return _fetch(observation, info, rng, patience=1.0)


def lazy(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Does nothing."""
    return NOOP


def _fetch(
    observation: NDArray[np.float32], info: Mapping[str, Any], rng: Generator, *, patience: float
) -> int:
    """What a robot does next; `patience`: how likely it waits where another one stands ahead."""
    is_loaded, is_on_highway = observation[2] > 0, observation[7] > 0
    cells = observation[OWN:].reshape(-1, SENSED)
    is_wanted = cells[len(cells) // 2, 6] > 0
    if (is_wanted and not is_loaded) or (is_loaded and not is_wanted and not is_on_highway):
        return TOGGLE
    if not is_loaded:
        wished = _ways(info["to_request"])
    elif is_wanted:
        wished = _ways(info["to_goal"])[::-1]
    else:
        wished = _ways(info["to_door"] if info["to_door"].any() else info["to_place"])
    sides = [WEST, EAST] if rng.random() < 0.5 else [EAST, WEST]
    waits = rng.random() < patience
    facing = int(observation[3:7].argmax())
    for way in [*wished, *sides, DOWN, UP]:
        if _is_free(observation, way, waits=waits):
            return _turn(facing, way)
    return NOOP


def _ways(offset: Any) -> list[int]:
    """The directions in which a cell lies, across before along."""
    right, down = int(offset[0]), int(offset[1])
    return [EAST if right > 0 else WEST] * bool(right) + [DOWN if down > 0 else UP] * bool(down)


def _is_free(observation: NDArray[np.float32], way: int, *, waits: bool) -> bool:
    """Whether a robot may go there: loaded it can't go under shelves."""
    cells = observation[OWN:].reshape(-1, SENSED)
    side = round(len(cells) ** 0.5)
    cell = cells[len(cells) // 2 + {UP: -side, DOWN: side, WEST: -1, EAST: 1}[way]]
    has_robot, has_shelf = cell[0] > 0, cell[5] > 0
    if has_robot:  # with what it carries it may move on
        return waits
    return not (observation[2] > 0 and has_shelf)


def _turn(facing: int, way: int) -> int:
    """The action that brings a robot nearer to going that way."""
    turns = (CLOCKWISE.index(way) - CLOCKWISE.index(facing)) % 4
    return (FORWARD, RIGHT, RIGHT, LEFT)[turns]
