"""Floors of the robotic warehouse: made from numbers or text, and as tables that rules read.

A floor is stored with a margin as wide as robots see, so that no rule asks whether a cell is on it.
Cells are numbers in that grid, row by row.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.interface.construction import nearest
from gamekeeper.tasks.arguments import check_whole

BEYOND, HIGHWAY, PLACE = range(3)
"""Kinds of cells: off the floor, a highway, a place for a shelf."""
SIZES: Final = {"tiny": (1, 3), "small": (2, 3), "medium": (2, 5), "large": (3, 5)}
"""Rows and columns of shelves. Source: `rware/__init__.py`, rware 2.0.0."""
CODES: Final = 15
"""Number of codes of a cell: 0 or 1 + its robot's direction, + 5 with a shelf, 10 wanted."""
SENSED: Final = 7
"""Numbers that a sensor gives of a cell: robot, its direction (4), shelf, wanted."""
OWN: Final = 8
"""Numbers that a robot knows of itself: x, y, loaded, direction (4), on a highway."""


@dataclass(frozen=True, slots=True)
class Floor:
    """Floor with places for shelves and goals; the rest are highways.

    Attributes:
        places: [rows, columns], True where a shelf belongs.
        goals: (x, y) of each, in the order in which they are served.
    """

    places: NDArray[np.bool_]
    goals: tuple[tuple[int, int], ...]

    @property
    def rows(self) -> int:
        """Number of rows of cells."""
        return int(self.places.shape[0])

    @property
    def columns(self) -> int:
        """Number of columns of cells."""
        return int(self.places.shape[1])

    @property
    def shelves(self) -> int:
        """Number of shelves."""
        return int(self.places.sum())


def floor_of(
    layout: str, *, shelf_rows: int | None, shelf_columns: int | None, column_height: int
) -> Floor:
    """The floor of a name, of numbers, or of text.

    Args:
        layout: `tiny`, `small`, `medium`, `large`, or a text of several rows: `x` a shelf's place,
            `.` a highway, `g` a goal, blanks ignored.
        shelf_rows, shelf_columns: blocks of shelves; given, they go before the name's.
        column_height: cells of a block.
    Raises:
        SpecError: there is no such floor, or the text is none.
    """
    text = layout.strip().replace(" ", "").lower()
    if text and set(text) <= set("x.g\n"):
        return _from_text(text.split("\n"))
    if layout not in SIZES:
        raise SpecError(
            f"there is no layout called {layout!r}{nearest(layout, SIZES)}",
            where="layout",
            expected=f"one of {', '.join(SIZES)}, or rows of the letters x . g",
            actual=repr(layout)[:200],
            fix="use one of these names, or draw the floor in letters",
        )
    rows, columns = SIZES[layout]
    return _from_numbers(shelf_rows or rows, shelf_columns or columns, column_height)


def _from_numbers(shelf_rows: int, shelf_columns: int, height: int) -> Floor:
    """Blocks of two columns of shelves, with room to queue before the two goals.

    Source: `Warehouse._make_layout_from_params`, rware 2.0.0.
    """
    numbers = {"shelf_rows": shelf_rows, "shelf_columns": shelf_columns, "column_height": height}
    for name, number in numbers.items():
        check_whole(name, number, 1)
    if shelf_columns % 2 == 0:
        raise SpecError(
            "an even number of columns leaves no cells before the goals",
            where="shelf_columns",
            expected="an odd number",
            actual=repr(shelf_columns),
            fix="give an odd number of columns",
        )
    rows, columns = (height + 1) * shelf_rows + 2, 3 * shelf_columns + 1
    middle = (columns // 2 - 1, columns // 2)
    y, x = np.indices((rows, columns))
    is_queue = (y > rows - (height + 3)) & np.isin(x, middle)
    is_highway = (x % 3 == 0) | (y % (height + 1) == 0) | (y == rows - 1) | is_queue
    return _checked(Floor(~is_highway, tuple((x, rows - 1) for x in middle)))


def _from_text(lines: list[str]) -> Floor:
    if len({len(line) for line in lines}) != 1:
        raise SpecError(
            "the rows of a layout differ in length",
            where="layout",
            expected=f"{len(lines[0])} letters in every row",
            actual=", ".join(str(len(line)) for line in lines),
            fix="make all rows equally long; x is a shelf, g a goal, . a highway",
        )
    letters = np.array([list(line) for line in lines])
    goals = tuple((int(x), int(y)) for y, x in np.argwhere(letters == "g"))
    return _checked(Floor(letters == "x", goals))


def _checked(floor: Floor) -> Floor:
    if not floor.goals or floor.shelves < 2:
        raise SpecError(
            "nothing can be delivered on such a floor",
            where="layout",
            expected="a goal, and two shelves or more",
            actual=f"{len(floor.goals)} goals, {floor.shelves} shelves",
            fix="add a g for a goal and an x for each shelf",
        )
    return floor


def tables_of(
    floor: Floor, *, margin: int, requests: int, inactivity: int, pays: int, is_scaled: bool
) -> NDArray[Any]:
    """The floor and the numbers of `RoboticWarehouse` as the record that rules read."""
    rows, columns = floor.rows, floor.columns
    width, side = columns + 2 * margin, 2 * margin + 1
    inside = np.pad(np.ones((rows, columns), bool), margin)
    places = np.pad(floor.places, margin)
    cells = np.flatnonzero(inside)
    homes = np.flatnonzero(places)
    goals = [(y + margin) * width + x + margin for x, y in floor.goals]
    fields = np.dtype(
        [
            ("floor", "i1", (inside.size,)),
            ("cells", "i4", (cells.size,)),
            ("homes", "i4", (homes.size,)),
            ("goals", "i4", (len(goals),)),
            ("around", "i4", (side * side,)),
            ("ahead", "i4", (4,)),
            ("turned", "i1", (2, 4)),
            ("own", "f4", (inside.size, 3)),
            ("sensed", "f4", (CODES, 1 + SENSED)),
            ("requests", "i4"),
            ("inactivity", "i4"),
            ("pays", "i4"),
        ],
        align=True,
    )
    tables = np.zeros(1, fields)
    t = tables[0]
    t["floor"] = np.where(inside, np.where(places, PLACE, HIGHWAY), BEYOND).ravel()
    t["cells"], t["homes"], t["goals"] = cells, homes, goals
    y, x = np.divmod(np.arange(side * side), side)
    t["around"] = (y - margin) * width + x - margin
    t["ahead"] = (-width, width, -1, 1)  # up, down, left, right
    t["turned"] = ((2, 3, 1, 0), (3, 2, 0, 1))  # to the left, to the right
    y, x = np.divmod(np.arange(inside.size), width)
    scale = (max(columns - 1, 1), max(rows - 1, 1)) if is_scaled else (1, 1)
    t["own"] = np.stack([(x - margin) / scale[0], (y - margin) / scale[1], ~places.ravel()], 1)
    t["sensed"][:, 1:] = [_sensed(code) for code in range(CODES)]
    t["requests"], t["inactivity"], t["pays"] = requests, inactivity, pays
    return tables


def _sensed(code: int) -> list[float]:
    """Numbers of a sensor for a cell; without a robot it has a direction too, as in rware."""
    shelf, robot = divmod(code, 5)
    facing = max(robot - 1, 0)
    return [
        float(robot > 0),
        *(float(facing == d) for d in range(4)),
        float(shelf > 0),
        float(shelf == 2),
    ]


def reach(floor: Floor, margin: int) -> int:
    """Number of cells of the floor with its margin."""
    return math.prod(side + 2 * margin for side in floor.places.shape)
