"""The warehouse as text and as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.envs import drawing
from gamekeeper.envs.drawing import Canvas, Color
from gamekeeper.envs.layouts import NOWHERE

if TYPE_CHECKING:
    from gamekeeper.envs.warehouse import WarehouseRules

SIGNS: Final = {".": ".", "#": "#", "s": "%", "h": "_", "d": "=", "c": "+"}
COLORS: Final[dict[str, Color]] = {
    "#": drawing.INK,
    "s": drawing.WOOD,
    "h": (206, 212, 218),
    "d": drawing.GREEN,
    "c": drawing.YELLOW,
}
ROBOTS: Final[dict[str, Color]] = {"picker": drawing.BLUE, "carrier": drawing.ORANGE}


def draw(task: WarehouseRules) -> str | NDArray[np.uint8]:
    """What `render` gives in the task's mode."""
    return _text(task) if task.render_mode == "ansi" else _picture(task)


def _text(task: WarehouseRules) -> str:
    """The floor in letters.

    `p c` robots (capital with an item), `%` shelf (or its open orders), `_` hand-over cell (`*`
    with an item), `=` dock, `+` charger, `#` wall.
    """
    floor = task.floor
    letters = [SIGNS[letter] for letter in floor.text]
    for cell, count in zip(floor.shelves, task.wanted, strict=True):
        if count:
            letters[cell] = str(min(count, 9))
    for cell in task.lying:
        letters[cell] = "*"
    for cell, agent in task.stands.items():
        robot = task.robots[agent]
        letters[cell] = robot.role[0] if robot.load == NOWHERE else robot.role[0].upper()
    rows = (letters[at : at + floor.width] for at in range(0, floor.size, floor.width))
    weak = [a for a in task.stands.values() if 4 * task.robots[a].battery <= task.battery]
    return drawing.text_of(
        rows,
        f"tick {task.ticks}, delivered {task.delivered} of {task.orders}",
        f"low battery: {', '.join(weak)}" if weak else "",
    )


def _picture(task: WarehouseRules) -> NDArray[np.uint8]:
    """Robots are discs with their battery under them; items and open orders are red."""
    floor = task.floor
    canvas = Canvas(floor.width, floor.height)
    for cell, letter in enumerate(floor.text):
        if letter in COLORS:
            canvas.fill(cell % floor.width, cell // floor.width, COLORS[letter], inset=0.04)
    items = [cell for cell, count in zip(floor.shelves, task.wanted, strict=True) if count]
    for cell in (*items, *task.lying):
        canvas.fill(cell % floor.width, cell // floor.width, drawing.RED, inset=0.3)
    for cell, agent in task.stands.items():
        robot, x, y = task.robots[agent], cell % floor.width, cell // floor.width
        canvas.disc(x, y, ROBOTS[robot.role])
        if robot.load != NOWHERE:
            canvas.fill(x, y, drawing.RED, inset=0.36)
        canvas.bar(x, y, robot.battery / task.battery, drawing.INK)
    return canvas.pixels
