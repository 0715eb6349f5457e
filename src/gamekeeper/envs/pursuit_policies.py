"""Scripted pursuers and evaders: functions of what one of them is shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Window: TypeAlias = NDArray[np.int8]
Way: TypeAlias = tuple[int, int]
"""Rows and columns from the middle of a window."""

STAY: Final = 0
STEPS: Final = ((0, 0), (-1, 0), (0, 1), (1, 0), (0, -1))
"""Rows and columns by action: nowhere, north, east, south, west."""
CLOSED, PURSUERS, EVADERS = range(3)
STRAIGHT: Final = 0.9
"""Probability that a pursuer which sees no evader goes on in the direction of its round."""
IMPATIENCE: Final = 0.25
"""Probability that a pursuer alone with an evader lets it be, to find somebody."""
APART: Final = 0.6
"""What a cell's distance from the partner counts for, in cells of one's own way to it."""
LEG: Final = 10
"""Ticks in one direction."""


def reference(observation: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Pursuers agree whom to hunt by what all of them see, and go rounds; evaders flee."""
    if agent.startswith("evader"):
        return _flee(observation, rng)
    target, partner = _agreed(observation)
    if target is not None and partner is not None:
        return _around(observation, target, partner, rng)
    if target is not None and rng.random() >= IMPATIENCE:
        return _towards(observation, target, rng)
    return _round(observation, agent, info, rng)


def greedy(observation: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Pursuers run at the evader that is nearest, whoever else does; evaders wander."""
    seen = [] if agent.startswith("evader") else _places(observation, EVADERS)
    if not seen:
        return int(rng.integers(len(STEPS)))
    return _towards(observation, min(seen, key=_length), rng)


def lazy(observation: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Stays where it is."""
    return STAY


def _places(window: Window, plane: int) -> list[Way]:
    """Where something is in a plane, rows and columns from the middle."""
    sight = len(window) // 2
    return [(y - sight, x - sight) for y, x in np.argwhere(window[..., plane]).tolist()]


def _length(way: Way) -> int:
    return abs(way[0]) + abs(way[1])


def _between(one: Way, other: Way) -> int:
    return abs(one[0] - other[0]) + abs(one[1] - other[1])


def _open(window: Window) -> list[int]:
    """The actions that lead nowhere else than into empty cells, or nowhere."""
    middle = len(window) // 2
    return [
        action
        for action, (down, right) in enumerate(STEPS)
        if action == STAY or not window[middle + down, middle + right].any()
    ]


def _agreed(window: Window) -> tuple[Way | None, Way | None]:
    """The evader that two pursuers can be at soonest, and who the other one is.

    Pursuers near each other see nearly the same, so that they choose the same evader.
    """
    others = [place for place in _places(window, PURSUERS) if place != (0, 0)]
    best, partner, soonest = None, None, None
    for evader in _places(window, EVADERS):
        near = sorted((_between(other, evader), k) for k, other in enumerate(others))
        if len(near) > 1 and near[1][0] < _length(evader):
            continue  # two others are nearer
        way = near[0][0] if near else len(window)
        when = max(_length(evader), way), _length(evader)
        if soonest is None or when < soonest:
            best, partner, soonest = evader, others[near[0][1]] if near else None, when
    return best, partner


def _around(window: Window, evader: Way, partner: Way, rng: Generator) -> int:
    """A step to the side of the evader that is near oneself and far from the partner."""
    sight, beside = len(window) // 2, []
    for down, right in STEPS[1:]:
        side = evader[0] + down, evader[1] + right
        is_seen = max(abs(side[0]), abs(side[1])) <= sight
        is_own = side == (0, 0)
        if is_own or (is_seen and not window[side[0] + sight, side[1] + sight].any()):
            beside.append((_length(side) - APART * _between(partner, side), side))
    if not beside:
        return _towards(window, evader, rng)
    goal = min(beside)[1]
    return STAY if goal == (0, 0) else _towards(window, goal, rng, arrives=True)


def _towards(window: Window, place: Way, rng: Generator, *, arrives: bool = False) -> int:
    """A step that shortens the way to a place, or to beside it; around what is in the way."""
    if _length(place) == 1 and not arrives:
        return STAY
    ways = {action: _between(STEPS[action], place) for action in _open(window)}
    shortest = min(ways.values())
    best = [action for action, way in ways.items() if way == shortest]
    if best == [STAY]:
        best = [action for action in ways if action != STAY] or best
    return int(best[int(rng.integers(len(best)))])


def _round(window: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Goes straight for LEG ticks, then another way; turns by chance at what is closed.

    Its energy tells the ticks; each number takes other ways.
    """
    number, leg = int(agent.rpartition("_")[2]), int(info["energy"]) // LEG
    actions = [action for action in _open(window) if action != STAY]
    if not actions:
        return STAY
    wanted = 1 + (number * 2654435761 + leg * 2246822519 >> 13) % 4
    if wanted in actions and rng.random() < STRAIGHT:
        return wanted
    return int(actions[int(rng.integers(len(actions)))])


def _flee(window: Window, rng: Generator) -> int:
    """Goes where the nearest pursuer is furthest; wanders where none is seen."""
    pursuers, actions = _places(window, PURSUERS), _open(window)
    if not pursuers:
        return int(rng.integers(len(STEPS)))
    room = [min(_between(STEPS[action], each) for each in pursuers) for action in actions]
    best = [action for action, far in zip(actions, room, strict=True) if far == max(room)]
    return int(best[int(rng.integers(len(best)))])
