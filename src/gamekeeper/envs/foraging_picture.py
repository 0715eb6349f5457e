"""The foraging field as text and as a picture, from its state."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.envs import drawing
from gamekeeper.envs.drawing import Canvas

DIGITS: Final = "0123456789"
LETTERS: Final = "_abcdefghijklmnopqrstuvwxyz"
DOTS: Final = 9
"""Levels that a picture can show, in dots three by three; higher ones look like the last."""


def draw(
    state: NDArray[np.int64], players: int, size: tuple[int, int], *, is_text: bool
) -> str | NDArray[np.uint8]:
    """Letters or pixels of (row, column, level) of each player, then of each food.

    Letters: `1` to `9` food by its level (`+`: higher), `a` a player of level 1, `b` of level 2 and
    so on, capital where several share a cell.
    """
    foods = [tuple(row) for row in state[players:].tolist() if row[2] > 0]
    there = [tuple(row) for row in state[:players].tolist()]
    return _text(there, foods, size) if is_text else _picture(there, foods, size)


def _text(
    players: list[tuple[int, ...]], foods: list[tuple[int, ...]], size: tuple[int, int]
) -> str:
    letters = [["."] * size[1] for _ in range(size[0])]
    for row, column, level in foods:
        letters[row][column] = DIGITS[level] if level < len(DIGITS) else "+"
    for row, column, level in players:
        is_taken = letters[row][column] != "."
        letter = LETTERS[min(level, len(LETTERS) - 1)]
        letters[row][column] = letter.upper() if is_taken else letter
    return drawing.text_of(letters)


def _picture(
    players: list[tuple[int, ...]], foods: list[tuple[int, ...]], size: tuple[int, int]
) -> NDArray[np.uint8]:
    """Food is green, players are blue; dots tell the level."""
    canvas = Canvas(size[1], size[0])
    for row, column, level in foods:
        canvas.fill(column, row, drawing.GREEN, inset=0.1)
        _dots(canvas, row, column, level)
    for row, column, level in players:
        canvas.disc(column, row, drawing.BLUE, radius=0.46)
        _dots(canvas, row, column, level)
    return canvas.pixels


def _dots(canvas: Canvas, row: int, column: int, level: int) -> None:
    for dot in range(min(level, DOTS)):
        y, x = divmod(dot, 3)
        canvas.rectangle(column + 0.24 + 0.2 * x, row + 0.24 + 0.2 * y, 0.12, 0.12, drawing.PAPER)
