"""The numbers of a warehouse: what its kernel holds of one copy, and what all copies share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.envs.layouts import CHARGER, CLOSED, DOCK, HAND_OVER, NOWHERE, SHELF, WALL, Layout
from gamekeeper.errors import SpecError
from gamekeeper.kernels.kernel import Field

REACH: Final = 2
"""Cells that a robot looks in each direction."""
ROOM: Final = 2 * REACH
"""Cells that a padded row is longer than the floor's."""
KINDS: Final = {".": 0, "#": 1, "s": 5, "h": 2, "d": 3, "c": 4}
"""Kinds of cells, as the state tells them."""
OPEN, WALLED, HANDS_OVER, DOCKS, CHARGES, SHELVES = range(6)
PLACES: Final = (SHELF, HAND_OVER, DOCK, CHARGER)
"""Kinds of places, in the order of their numbers."""
NEVER: Final = 1 << 62
"""The last tick where there is no horizon."""
MOST: Final = 10_000
"""What a count may be at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """How large a warehouse is; arguments as of `WarehouseRules`.

    Raises:
        SpecError: a number is out of its range, or the layout has too few cells.
    """

    pickers: int
    carriers: int
    spares: int
    orders: int
    every: int
    battery: int
    layout: Layout

    def __post_init__(self) -> None:
        least = {"pickers": 1, "carriers": 1, "spares": 0, "orders": 1, "every": 1, "battery": 1}
        for name, bound in least.items():
            value = getattr(self, name)
            if type(value) is not int or not bound <= value <= MOST:
                raise SpecError(
                    f"a warehouse can't have {name}={value!r}",
                    where=name,
                    expected=f"a whole number from {bound} to {MOST}",
                    seen=repr(value),
                )
        if self.pickers + self.carriers > len(self.layout.floors) // 2:
            raise SpecError(
                f"the layout {self.layout.name!r} has no room for so many robots",
                where="pickers, carriers",
                expected=f"at most {len(self.layout.floors) // 2}: half of its floor cells",
                seen=str(self.pickers + self.carriers),
                mend="take fewer robots, or layout='hall'",
            )

    @property
    def roles(self) -> dict[str, str]:
        """By robot, in the order of their numbers, its role: pickers, then carriers."""
        return {
            f"{role}_{i}": role
            for role, count in (("picker", self.pickers), ("carrier", self.carriers))
            for i in range(count + self.spares)
        }


def state_of(sizes: Sizes, *, is_parallel: bool) -> list[Field]:
    """The fields of one copy's state.

    Of each robot: cell (where it is, or was when it ended; NOWHERE for a spare), battery, load (the
    shelf whose item it has, or NOWHERE), drift (how far east and south of its cell it believes to
    be), and what the moves of a tick are resolved with (wants, refused). Of each cell: robot_at (1
    + the number of the robot there), claims (a tick's, zeros after it), and with REACH cells more
    on each side marks (0 none, 1 picker, 2 carrier). Of each shelf: wanted, its open orders; of
    each hand-over cell: lying, 1 + the shelf of the item there. Of each order: when it arrives, and
    the shelf that is asked. Where all act at once, of each goal: near, the two least ways that
    robots have to it.
    """
    floor, robots = sizes.layout, (len(sizes.roles),)
    shelves, hand_overs = len(floor.shelves), len(floor.hand_overs)
    padded = (floor.width + ROOM) * (floor.height + ROOM)
    fields: list[Field] = [
        ("clock", "i8"),
        ("delivered", "i8"),
        ("arrived", "i8"),
        ("cell", "i2", robots),
        ("battery", "i2", robots),
        ("load", "i2", robots),
        ("drift", "i2", (*robots, 2)),
        ("wants", "i2", robots),
        ("refused", "i1", robots),
        ("robot_at", "i2", (floor.size,)),
        ("claims", "i2", (floor.size,)),
        ("marks", "i1", (padded,)),
        ("wanted", "i2", (shelves,)),
        ("lying", "i2", (hand_overs,)),
        ("arrival", "i4", (sizes.orders,)),
        ("asked", "i2", (sizes.orders,)),
    ]
    if is_parallel:
        fields.append(("near", "i2", (shelves + hand_overs + len(floor.docks), 2)))
    return fields


def tables_of(sizes: Sizes, floor: Layout, *, horizon: int | None) -> NDArray[Any]:
    """What all copies share, an array of one record.

    Places are numbered through: shelves, hand-over cells, docks, chargers, each in reading order.

    Args:
        sizes: of the task.
        floor: the layout, or another one with as many cells and places of each kind.
        horizon: ticks.
    """
    cells = [cell for kind in PLACES for cell, letter in enumerate(floor.text) if letter == kind]
    number = np.full(floor.size, NOWHERE, np.int16)
    first = 0
    for kind in PLACES:
        count = floor.text.count(kind)
        number[cells[first : first + count]] = range(count)
        first += count
    kinds = np.array([KINDS[letter] for letter in floor.text], np.int8)
    seen = np.where(kinds == SHELVES, KINDS[WALL], kinds).reshape(floor.height, floor.width)
    ends = np.cumsum([floor.text.count(kind) for kind in PLACES]).tolist()
    parts: dict[str, Any] = {
        "width": floor.width,
        "pickers": sizes.pickers,
        "carriers": sizes.carriers,
        "first_carrier": sizes.pickers + sizes.spares,
        "every": sizes.every,
        "full": sizes.battery,
        "last_tick": horizon if type(horizon) is int else NEVER,
        "hand_overs": ends[0],
        "docks": ends[1],
        "chargers": ends[2],
        "floors": np.array(floor.floors, np.int16),
        "kinds": kinds,
        "seen": np.pad(seen, REACH, constant_values=KINDS[WALL]).ravel().astype(np.int8),
        "number": number,
        "ways": np.array(floor.ways, np.int16).T,
        "beside": _shelves_beside(floor, number),
        "places": np.array(cells, np.int16),
        "far": np.concatenate([floor.distances(kind) for kind in PLACES]).T,
    }
    dtype = [
        (name, value.dtype, value.shape) if isinstance(value, np.ndarray) else (name, "i8")
        for name, value in parts.items()
    ]
    tables = np.zeros(1, np.dtype(dtype, align=True))
    for name, value in parts.items():
        tables[name] = value
    return tables


def _shelves_beside(floor: Layout, number: NDArray[np.int16]) -> NDArray[np.int16]:
    """[cells, 4] numbers of the shelves north, east, south, west of an open cell, or NOWHERE."""
    found = np.full((floor.size, 4), NOWHERE, np.int16)
    for cell, letter in enumerate(floor.text):
        for side, near in enumerate(floor.beside(cell) if letter not in CLOSED else ()):
            if near != NOWHERE and floor.text[near] == SHELF:
                found[cell, side] = number[near]
    return found
