"""Scripted pursuers and evaders: functions of what one of them is shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Window = NDArray[np.int8]

STAY: Final = 0
STEPS: Final = ((0, 0), (-1, 0), (0, 1), (1, 0), (0, -1))
"""Rows and columns by action: nowhere, north, east, south, west."""
CLOSED, PURSUERS, EVADERS = range(3)
STRAIGHT: Final = 0.9
"""Probability that a pursuer which sees no evader goes on in the direction of its round."""
IMPATIENCE: Final = 0.1
"""Probability that a pursuer alone with an evader lets it be, to find somebody."""
LEG: Final = 10
"""Ticks in one direction."""


def reference(observation: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Pursuers agree whom to hunt by what all of them see, and go rounds; evaders flee."""
    if agent.startswith("evader"):
        return _flee(observation, rng)
    target, is_helped = _agreed(observation)
    if target is not None and (is_helped or rng.random() >= IMPATIENCE):
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


def _places(window: Window, plane: int) -> list[tuple[int, int]]:
    """Where something is in a plane, rows and columns from the middle."""
    sight = len(window) // 2
    return [(y - sight, x - sight) for y, x in np.argwhere(window[..., plane]).tolist()]


def _length(way: tuple[int, int]) -> int:
    return abs(way[0]) + abs(way[1])


def _between(one: tuple[int, int], other: tuple[int, int]) -> int:
    return abs(one[0] - other[0]) + abs(one[1] - other[1])


def _open(window: Window) -> list[int]:
    """The actions that lead nowhere else than into empty cells, or nowhere."""
    middle = len(window) // 2
    return [
        action
        for action, (down, right) in enumerate(STEPS)
        if action == STAY or not window[middle + down, middle + right].any()
    ]


def _agreed(window: Window) -> tuple[tuple[int, int] | None, bool]:
    """The evader that two pursuers can be at soonest, and whether a second one is in sight.

    Pursuers near each other see nearly the same, so that they choose the same one.
    """
    others = [place for place in _places(window, PURSUERS) if place != (0, 0)]
    best, soonest = None, None
    for evader in _places(window, EVADERS):
        ways = sorted(_between(other, evader) for other in others)
        if len(ways) > 1 and ways[1] < _length(evader):
            continue  # two others are nearer
        when = max(_length(evader), ways[0] if ways else len(window)), _length(evader)
        if soonest is None or when < soonest:
            best, soonest = evader, when
    return best, bool(others)


def _towards(window: Window, place: tuple[int, int], rng: Generator) -> int:
    """A step that shortens the way, or holds where the evader is beside; else around."""
    if _length(place) == 1:
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
