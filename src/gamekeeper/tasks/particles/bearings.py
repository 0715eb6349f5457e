"""Observations of particles, as rules: bodies as seen from an agent's place.

`obs[row]` is filled from place `at` on, and the first free place behind is returned. Bodies of a
kind come in their order; or so many of the nearest, the nearest first, and zeros where there are
fewer.

Source: mpe2 1.1.1, `_mpe_utils/partial_observability.py`.
"""

import math
from typing import Any, Final

from gamekeeper.kernels.scalar_rules import inlined, rule

NO_BODY: Final = -1


@inlined
def show_self(s, i, obs, row):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shows an agent its own velocity and place."""
    at = show_pair(obs, row, 0, s.vx[i], s.vy[i])
    return show_pair(obs, row, at, s.x[i], s.y[i])


@inlined
def show_pair(obs, row, at, x, y):  # type: ignore[no-untyped-def]  # likewise
    """Writes the two numbers of a vector."""
    obs[row, at] = x
    obs[row, at + 1] = y
    return at + 2


@inlined
def show_mark(s, i, k, obs, row, at):  # type: ignore[no-untyped-def]  # likewise
    """Shows an agent one mark."""
    return show_pair(obs, row, at, s.mark_x[k] - s.x[i], s.mark_y[k] - s.y[i])


@inlined
def show_other(s, i, j, obs, row, at):  # type: ignore[no-untyped-def]  # likewise
    """Shows an agent one other agent."""
    return show_pair(obs, row, at, s.x[j] - s.x[i], s.y[j] - s.y[i])


@inlined
def show_marks(s, i, obs, row, at):  # type: ignore[no-untyped-def]  # likewise
    """Shows an agent all marks."""
    for k in range(len(s.mark_x)):
        at = show_mark(s, i, k, obs, row, at)
    return at


@inlined
def show_others(s, i, obs, row, at):  # type: ignore[no-untyped-def]  # likewise
    """Shows an agent all other agents."""
    for j in range(len(s.x)):
        if j != i:
            at = show_other(s, i, j, obs, row, at)
    return at


@inlined
def show_nothing(obs, row, at, end):  # type: ignore[no-untyped-def]  # likewise
    """Writes zeros."""
    for place in range(at, end):
        obs[row, place] = 0.0
    return max(at, end)


@rule
def next_mark(s, i, far, last):  # type: ignore[no-untyped-def]  # likewise
    """Finds the nearest mark of those behind `last`, which is `far` (squared) away.

    Returns its number and how far it is, squared. Of equally near ones the lowest number comes
    first. To begin with `last` is NO_BODY and `far` below 0; NO_BODY is returned at the end.
    """
    found, best = NO_BODY, math.inf
    for k in range(len(s.mark_x)):
        dx = s.mark_x[k] - s.x[i]
        dy = s.mark_y[k] - s.y[i]
        d = dx * dx + dy * dy
        if d < best and (d > far or (d == far and k > last)):
            found, best = k, d
    return found, best


@rule
def next_other(s, i, far, last):  # type: ignore[no-untyped-def]  # likewise
    """Finds the same of other agents."""
    found, best = NO_BODY, math.inf
    for j in range(len(s.x)):
        dx = s.x[j] - s.x[i]
        dy = s.y[j] - s.y[i]
        d = dx * dx + dy * dy
        if j != i and d < best and (d > far or (d == far and j > last)):
            found, best = j, d
    return found, best


def marks_shower(count: int | None) -> Any:
    """Returns `show(s, i, obs, row, at)`: the `count` nearest marks; None: all."""
    return show_marks if count is None else _nearest_shower(count, next_mark, show_mark)


def others_shower(count: int | None) -> Any:
    """Returns `show(s, i, obs, row, at)`: the `count` nearest other agents; None: all."""
    return show_others if count is None else _nearest_shower(count, next_other, show_other)


def _nearest_shower(count: int, following: Any, show_one: Any) -> Any:
    """Returns a rule that shows the nearest bodies, the nearest first, and zeros for missing ones.

    Args:
        following: `following(s, i, far, last)`: the next body by distance.
        show_one: `show_one(s, i, body, obs, row, at)`.
    """

    @rule
    def show(s: Any, i: Any, obs: Any, row: Any, at: Any) -> Any:
        end = at + 2 * count
        last, far = NO_BODY, -1.0
        for _ in range(count):
            last, far = following(s, i, far, last)
            if last == NO_BODY:
                break
            at = show_one(s, i, last, obs, row, at)
        return show_nothing(obs, row, at, end)

    return show


def overview_of(observe: Any, shapes: list[tuple[int, int]]) -> Any:
    """Returns `overview(s, t, state)`: all observations in a row, as mpe2's `state()`.

    Args:
        observe: the rule that shows it.
        shapes: agents and length of an observation, of each group of agents.
    """
    (first, length), (second, other) = (*shapes, (0, 0))[:2]
    cut = first * length

    @rule
    def overview(s: Any, t: Any, state: Any) -> None:
        observe(s, t, state.reshape((first, length)))

    @rule
    def overview_of_two(s: Any, t: Any, state: Any) -> None:
        one = state[:cut].reshape((first, length))
        observe(s, t, (one, state[cut:].reshape((second, other))))

    return overview if len(shapes) == 1 else overview_of_two
