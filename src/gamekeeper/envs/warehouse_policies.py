"""Scripted robots for the warehouse: functions of what one robot is shown.

They follow the shortest ways that observations tell and differ in what they do about each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.envs.warehouse_moves import HANDLE, NOOP
from gamekeeper.envs.warehouse_sight import KINDS_AT, OWN, PLACE, ROBOTS_AT, SIDE

Seen = NDArray[np.int16]

BATTERY, LACK = 4, 5
PRESENT, _EAST, _SOUTH, MOVES, RIVAL, WAYS = range(6)
CHARGER: Final = OWN + 2 * PLACE
CENTRE: Final = SIDE * SIDE // 2
STEPS: Final = (-SIDE, 1, SIDE, -1)
"""What a move adds to a position in the window."""
RESERVE: Final = 10
"""Units of battery that are kept for detours on the way to a charger."""
ENOUGH: Final = 50
"""Units of battery with which a charging robot goes back to work, if it holds so many."""
MARKED, CHARGER_KIND = 2, 4
"""Kinds of cells from which on others may want them, and the charger's."""
WANDER: Final = 0.1
"""Probability that a greedy robot does something else for once."""
GIVE_WAY: Final = 0.4
"""Probability to let others go first where they may want the same cell."""


def reference(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Takes goals nobody else is nearer to, gives way, makes room, and recharges in time."""
    mask = info["action_mask"]
    battery, here = int(observation[BATTERY]), int(observation[KINDS_AT + CENTRE])
    if here == CHARGER_KIND and battery < ENOUGH and observation[LACK]:
        return NOOP
    if battery <= int(observation[CHARGER + MOVES]) + RESERVE:
        return _towards(observation, CHARGER, mask, rng)
    if mask[HANDLE]:
        return HANDLE
    goal = _goal(observation)
    if goal is not None:
        return _towards(observation, goal, mask, rng)
    crowded = any(observation[ROBOTS_AT + CENTRE + step] for step in STEPS)
    return _aside(observation, mask, rng) if here >= MARKED or crowded else NOOP


def greedy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Takes the nearest goal by any way, whoever is in it; wanders at times; never recharges."""
    mask = info["action_mask"]
    if mask[HANDLE]:
        return HANDLE
    moves = [move for move in range(4) if mask[move]]
    ways = [move for move in moves if observation[OWN + WAYS + move]]
    if ways and rng.random() >= WANDER:
        return ways[int(rng.integers(len(ways)))]
    return moves[int(rng.integers(len(moves)))] if moves else NOOP


def lazy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Stays where it is, and handles what is within reach."""
    return HANDLE if info["action_mask"][HANDLE] else NOOP


def _goal(seen: Seen) -> int | None:
    """The first goal that no rival is nearer to; None where rivals are nearer to both."""
    for at in (OWN, OWN + PLACE):
        if seen[at + PRESENT] and seen[at + MOVES] <= seen[at + RIVAL]:
            return at
    return None


def _towards(seen: Seen, at: int, mask: Any, rng: Generator) -> int:
    """A move on a shortest way into a free cell; now and then aside, where there is none."""
    if not seen[at + MOVES]:  # it believes to be there and can't handle: it must be elsewhere
        return _aside(seen, mask, rng)
    ways = [move for move in range(4) if seen[at + WAYS + move] and mask[move]]
    free = [move for move in ways if not seen[ROBOTS_AT + CENTRE + STEPS[move]]]
    if not free:
        return _aside(seen, mask, rng) if rng.random() < 0.5 else NOOP
    calm = [move for move in free if not _is_contended(seen, move)]
    if calm:
        return calm[int(rng.integers(len(calm)))]
    if rng.random() < GIVE_WAY:
        return NOOP
    return free[int(rng.integers(len(free)))]


def _aside(seen: Seen, mask: Any, rng: Generator) -> int:
    """Any move into a free cell, before others that nobody else may want; else none."""
    moves = [move for move in range(4) if mask[move]]
    free = [move for move in moves if not seen[ROBOTS_AT + CENTRE + STEPS[move]]]
    calm = [move for move in free if not _is_contended(seen, move)]
    if not calm and rng.random() < GIVE_WAY:
        return NOOP
    chosen = calm or free
    return chosen[int(rng.integers(len(chosen)))] if chosen else NOOP


def _is_contended(seen: Seen, move: int) -> bool:
    """Another robot stands next to the cell that the move leads to."""
    ahead = CENTRE + STEPS[move]
    return any(seen[ROBOTS_AT + ahead + step] for step in STEPS if ahead + step != CENTRE)
