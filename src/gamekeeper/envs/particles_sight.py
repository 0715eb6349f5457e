"""What particles see of each other, as rules: places as seen from where they stand.

`obs[row]` is filled from place `at` on, and the first free place behind is returned. Each of a kind
in its order, or so many of the nearest of it, the nearest first, and zeros where there are fewer.

Source: mpe2 1.1.1, `_mpe_utils/partial_observability.py`.
"""

from __future__ import annotations

import math
from typing import Any, Final

from gamekeeper.kernels.rules import inlined, rule

NOBODY: Final = -1


@inlined
def show_self(s, i, obs, row):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """An agent's own velocity and place."""
    obs[row, 0] = s.vx[i]
    obs[row, 1] = s.vy[i]
    obs[row, 2] = s.x[i]
    obs[row, 3] = s.y[i]
    return 4


@inlined
def show_marks(s, i, obs, row, at):  # type: ignore[no-untyped-def]  # likewise
    """All marks."""
    for k in range(len(s.mark_x)):
        obs[row, at] = s.mark_x[k] - s.x[i]
        obs[row, at + 1] = s.mark_y[k] - s.y[i]
        at += 2
    return at


@inlined
def show_others(s, i, obs, row, at):  # type: ignore[no-untyped-def]  # likewise
    """All other agents."""
    for j in range(len(s.x)):
        if j != i:
            obs[row, at] = s.x[j] - s.x[i]
            obs[row, at + 1] = s.y[j] - s.y[i]
            at += 2
    return at


@inlined
def show_nothing(obs, row, at, end):  # type: ignore[no-untyped-def]  # likewise
    """Zeros."""
    for place in range(at, end):
        obs[row, place] = 0.0
    return max(at, end)


@rule
def next_mark(s, i, far, last):  # type: ignore[no-untyped-def]  # likewise
    """The nearest mark of those farther than `last`, which is `far` (squared) away; how far it is.

    To begin with `last` is NOBODY and `far` below 0. NOBODY is left at the end.
    """
    found, best = NOBODY, math.inf
    for k in range(len(s.mark_x)):
        dx = s.mark_x[k] - s.x[i]
        dy = s.mark_y[k] - s.y[i]
        d = dx * dx + dy * dy
        if d < best and (d > far or (d == far and k > last)):
            found, best = k, d
    return found, best


@rule
def next_other(s, i, far, last):  # type: ignore[no-untyped-def]  # likewise
    """The same of other agents."""
    found, best = NOBODY, math.inf
    for j in range(len(s.x)):
        dx = s.x[j] - s.x[i]
        dy = s.y[j] - s.y[i]
        d = dx * dx + dy * dy
        if j != i and d < best and (d > far or (d == far and j > last)):
            found, best = j, d
    return found, best


def marks_shower(count: int | None) -> Any:
    """`show(s, i, obs, row, at)`: the `count` nearest marks; None: all."""
    if count is None:
        return show_marks

    @rule
    def show(s: Any, i: Any, obs: Any, row: Any, at: Any) -> Any:
        last, far = NOBODY, -1.0
        end = at + 2 * count
        for _ in range(min(count, len(s.mark_x))):
            last, far = next_mark(s, i, far, last)
            obs[row, at] = s.mark_x[last] - s.x[i]
            obs[row, at + 1] = s.mark_y[last] - s.y[i]
            at += 2
        return show_nothing(obs, row, at, end)

    return show


def others_shower(count: int | None) -> Any:
    """`show(s, i, obs, row, at)`: the `count` nearest other agents; None: all."""
    if count is None:
        return show_others

    @rule
    def show(s: Any, i: Any, obs: Any, row: Any, at: Any) -> Any:
        last, far = NOBODY, -1.0
        end = at + 2 * count
        for _ in range(min(count, len(s.x) - 1)):
            last, far = next_other(s, i, far, last)
            obs[row, at] = s.x[last] - s.x[i]
            obs[row, at + 1] = s.y[last] - s.y[i]
            at += 2
        return show_nothing(obs, row, at, end)

    return show


def overview_of(observe: Any, shapes: list[tuple[int, int]]) -> Any:
    """`overview(s, t, state)`: what all agents see, one behind the other, as mpe2's `state()`.

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
