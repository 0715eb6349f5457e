"""Pictures of grids without any graphics library: rectangles in an array, letters in rows."""

from collections.abc import Iterable
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Color: TypeAlias = tuple[int, int, int]

PAPER: Final = (246, 244, 239)
INK: Final = (52, 58, 64)
STONE: Final = (134, 142, 150)
WOOD: Final = (176, 137, 104)
BLUE: Final = (34, 113, 178)
ORANGE: Final = (213, 94, 0)
GREEN: Final = (0, 158, 115)
YELLOW: Final = (240, 200, 66)
RED: Final = (190, 30, 45)
"""Colours that people with red-green blindness tell apart. Source: Okabe & Ito 2008, adapted."""
CELL: Final = 24
"""Side of a cell in pixels."""


class Canvas:
    """An rgb picture of a grid; `pixels` is [rows * cell, columns * cell, 3] uint8, red first."""

    def __init__(
        self, columns: int, rows: int, *, cell: int = CELL, background: Color = PAPER
    ) -> None:
        self.cell = cell
        self.pixels: NDArray[np.uint8] = np.empty((rows * cell, columns * cell, 3), np.uint8)
        self.pixels[:] = background

    def fill(self, column: int, row: int, color: Color, *, inset: float = 0.0) -> None:
        """Fills a cell, but for a margin of `inset` (part of a cell, below 0.5) on each side."""
        self.rectangle(column + inset, row + inset, 1 - 2 * inset, 1 - 2 * inset, color)

    def disc(self, column: int, row: int, color: Color, *, radius: float = 0.4) -> None:
        """Draws a disc in the middle of a cell; the radius is in cells."""
        axis = (np.arange(self.cell) + 0.5) / self.cell - 0.5
        inside = axis[:, None] ** 2 + axis[None, :] ** 2 <= radius**2
        top, left = row * self.cell, column * self.cell
        self.pixels[top : top + self.cell, left : left + self.cell][inside] = color

    def bar(self, column: int, row: int, part: float, color: Color) -> None:
        """Draws a level from 0 to 1 along the lower edge of a cell."""
        self.rectangle(column + 0.1, row + 0.86, 0.8 * min(max(part, 0.0), 1.0), 0.1, color)

    def rectangle(self, left: float, top: float, width: float, height: float, color: Color) -> None:
        """Fills a rectangle given in cells; what lies outside the picture isn't drawn."""
        first_row, first = max(round(top * self.cell), 0), max(round(left * self.cell), 0)
        end_row, end = round((top + height) * self.cell), round((left + width) * self.cell)
        self.pixels[first_row : max(end_row, 0), first : max(end, 0)] = color


class Pictured:
    """A task that writes `letters` and `pixels`, and renders one of them by its mode.

    It stands before the kernel's environment class among a task's bases.
    """

    render_mode: str | None

    def letters(self) -> str:
        """Picture in letters, for `ansi`."""
        raise NotImplementedError(f"{type(self).__name__} has no letters()")

    def pixels(self) -> NDArray[np.uint8]:
        """Picture [height, width, 3], red first, for `rgb_array`."""
        raise NotImplementedError(f"{type(self).__name__} has no pixels()")

    def render(self) -> str | NDArray[np.uint8] | None:
        """Returns the picture in letters or in pixels; None without a render mode."""
        if self.render_mode == "ansi":
            return self.letters()
        return self.pixels() if self.render_mode == "rgb_array" else None


def metadata_of(name: str, *, fps: int, is_parallelizable: bool = True) -> dict[str, Any]:
    """Returns PettingZoo's metadata of a task that is drawn in letters and in pixels."""
    return {
        "name": name,
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": fps,
        "is_parallelizable": is_parallelizable,
    }


def text_of(rows: Iterable[Iterable[str]], *notes: str) -> str:
    """Returns the letters of a grid as lines, with notes under them."""
    return "\n".join(["".join(row) for row in rows] + [note for note in notes if note])
