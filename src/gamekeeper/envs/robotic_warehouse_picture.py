"""The robotic warehouse as text and as a picture, from its state by cell."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.envs import drawing
from gamekeeper.envs.drawing import Canvas
from gamekeeper.envs.robotic_warehouse_floor import PLACE

ARROWS: Final = "^v<>"
LOADED: Final = "AVLR"
SHELVES: Final = ".xX"
NOSE: Final = ((0.42, 0.1), (0.42, 0.74), (0.1, 0.42), (0.74, 0.42))
"""Where a robot's front is in its cell, by direction: left and top, in cells."""


def draw(state: NDArray[np.int32], tables: Any, *, is_text: bool) -> str | NDArray[np.uint8]:
    """Letters or pixels of [robots, directions, loads, shelves] by row and column.

    Letters: `^ v < >` a robot, `A V L R` a loaded one, `x` shelf, `X` requested shelf, `_` a place
    without its shelf, `g` goal.
    """
    rows, columns = state.shape[1:]
    kinds = tables["floor"][tables["cells"]].reshape(rows, columns)
    goals = np.isin(tables["cells"], tables["goals"]).reshape(rows, columns)
    return _text(state, kinds, goals) if is_text else _picture(state, kinds, goals)


def _text(state: NDArray[np.int32], kinds: NDArray[Any], goals: NDArray[Any]) -> str:
    _, facing, loads, shelves = state
    empty = np.where(goals, "g", np.where(kinds == PLACE, "_", "."))
    letters = np.where(shelves > 0, np.take(list(SHELVES), shelves), empty)
    robots = np.where(
        loads > 0, np.take(list(LOADED), facing - 1), np.take(list(ARROWS), facing - 1)
    )
    return drawing.text_of(np.where(facing > 0, robots, letters))


def _picture(
    state: NDArray[np.int32], kinds: NDArray[Any], goals: NDArray[Any]
) -> NDArray[np.uint8]:
    robots, facing, loads, shelves = state
    canvas = Canvas(state.shape[2], state.shape[1])
    for y, x in np.argwhere((kinds == PLACE) | goals):
        canvas.fill(x, y, drawing.GREEN if goals[y, x] else (226, 221, 211), inset=0.04)
    for y, x in np.argwhere(shelves > 0):
        canvas.fill(x, y, drawing.RED if shelves[y, x] == 2 else drawing.WOOD, inset=0.12)
    for y, x in np.argwhere(robots > 0):
        canvas.disc(x, y, drawing.ORANGE if loads[y, x] else drawing.BLUE, radius=0.32)
        left, top = NOSE[facing[y, x] - 1]
        canvas.rectangle(x + left, y + top, 0.16, 0.16, drawing.INK)
    return canvas.pixels
