"""Numbers of a warehouse: the fields of one copy's state, and the tables that all copies share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.interface.construction import nearest
from gamekeeper.kernels.kernel import Field
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.arguments import NEVER, check_whole

FLOOR, WALL, SHELF, HAND_OVER, DOCK, CHARGER = LETTERS = ".#shdc"
CLOSED: Final = (WALL, SHELF)
NEEDED: Final = {SHELF: "shelf", HAND_OVER: "hand-over cell", DOCK: "dock", CHARGER: "charger"}
FAR: Final = 10_000
"""The distance to what can't be reached, in cells; more than any way is long."""
LONGEST: Final = 99
"""Cells along a side: two coordinates and a way along the sides stay below FAR."""
NOWHERE: Final = -1
TRIES: Final = 200
"""Shufflings before a layout counts as too crowded to shuffle."""

NAMED: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "small": (
            "...........",
            ".ss.sss.ss.",
            ".ss.sss.ss.",
            "...........",
            "...........",
            "..h..h..h..",
            "...........",
            "...........",
            "c...ddd...c",
        ),
        "wide": (
            ".....................",
            ".ss.sss.sss.sss.sss..",
            ".ss.sss.sss.sss.sss..",
            ".....................",
            ".ss.sss.sss.sss.sss..",
            ".ss.sss.sss.sss.sss..",
            ".....................",
            ".....................",
            "..h..h..h...h..h..h..",
            ".....................",
            ".....................",
            "c.c...ddd...ddd...c.c",
        ),
        "ring": (
            "sssssssssssss",
            ".............",
            ".............",
            "..##h#h#h##..",
            "..#########..",
            "..##d#d#d##..",
            ".............",
            ".............",
            "c.c.......c.c",
        ),
    }
)
HALL: Final = (60, 34)
"""Columns and rows of `hall`, the layout for hundreds of robots."""


class FloorLayout:
    """A floor that robots can work on; it never changes, so copies of it are itself.

    Attributes:
        name: of the layout.
        rows: its text; `text` in one.
        size: number of cells.
        shelves, hand_overs, docks, chargers, floors: the cells of each kind, in reading order.
        ways: by move 0 to 3 (north, east, south, west) and cell, the cell that it leads to, or
            NOWHERE.
    """

    def __init__(self, rows: tuple[str, ...], *, name: str = "custom") -> None:
        """Reads the text.

        Raises:
            SpecError: it isn't a rectangle of these letters, a kind of cell is missing, or a place
                can't be reached.
        """
        self.rows, self.name = tuple(rows), name
        self.height, self.width = len(self.rows), len(self.rows[0]) if self.rows else 0
        self.size, self.text = self.width * self.height, "".join(self.rows)
        self._check_text()
        self.shelves, self.hand_overs, self.docks, self.chargers, self.floors = map(
            self.cells_of, (SHELF, HAND_OVER, DOCK, CHARGER, FLOOR)
        )
        self.ways = self._ways()
        self._fields: dict[str, NDArray[np.int16]] = {}
        self._check_reach()

    def cells_of(self, kind: str) -> tuple[int, ...]:
        """Cells of a kind, in reading order."""
        return tuple(cell for cell, letter in enumerate(self.text) if letter == kind)

    def beside(self, cell: int) -> list[int]:
        """The cells north, east, south and west of one, NOWHERE outside; shelves too."""
        x, y = cell % self.width, cell // self.width
        return [
            j * self.width + i if 0 <= i < self.width and 0 <= j < self.height else NOWHERE
            for i, j in ((x, y - 1), (x + 1, y), (x, y + 1), (x - 1, y))
        ]

    def distances(self, kind: str) -> NDArray[np.int16]:
        """[cells of the kind, cells] moves from each cell to each; to beside it for shelves.

        Worked out when it is first asked for; FAR from walls and shelves.
        """
        if kind not in self._fields:
            cells = self.cells_of(kind)
            goals = np.zeros((len(cells), self.size), dtype=bool)
            for number, cell in enumerate(cells):
                for end in self.beside(cell) if kind == SHELF else [cell]:
                    if end != NOWHERE and self.text[end] not in CLOSED:
                        goals[number, end] = True
            self._fields[kind] = self._spread(goals)
        return self._fields[kind]

    def shuffled(self, rng: Stream) -> FloorLayout:
        """Another floor of the same size with as many cells of each kind, elsewhere.

        Walls stay. Shelves are placed one by one where they cut no way in two.

        Raises:
            SpecError: it is too crowded for that.
        """
        counts = {kind: self.text.count(kind) for kind in NEEDED}
        for _ in range(TRIES):
            letters = [WALL if letter == WALL else FLOOR for letter in self.text]
            free = [cell for cell, letter in enumerate(letters) if letter == FLOOR]
            rng.shuffle(free)
            left = counts[SHELF]
            for cell in free:
                if left and self._parts_nothing(letters, cell):
                    letters[cell] = SHELF
                    left -= 1
            free = [cell for cell in free if letters[cell] == FLOOR]
            for kind in (HAND_OVER, DOCK, CHARGER):
                for _ in range(counts[kind] if not left else 0):
                    letters[free.pop()] = kind
            text = "".join(letters)
            rows = tuple(text[at : at + self.width] for at in range(0, self.size, self.width))
            try:
                return FloorLayout(rows, name=f"{self.name}, shuffled")
            except SpecError:
                continue
        raise SpecError(
            f"the layout {self.name!r} is too crowded to shuffle",
            where="held_out",
            expected="space for every shelf to be reached",
            actual=f"{counts[SHELF]} shelves on {self.size} cells",
            fix="choose a layout with more open floor, or held_out=0",
        )

    def _parts_nothing(self, letters: list[str], cell: int) -> bool:
        """True if the open cells around one stay joined around it once it is closed."""
        x, y = cell % self.width, cell // self.width
        ring = ((0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1))
        is_open = [
            0 <= x + i < self.width
            and 0 <= y + j < self.height
            and letters[(y + j) * self.width + x + i] not in CLOSED
            for i, j in ring
        ]
        # A corner alone joins nothing: robots don't drive diagonally.
        kept = [
            is_open[k] and (k % 2 == 0 or is_open[k - 1] or is_open[(k + 1) % 8]) for k in range(8)
        ]
        sides = sum(kept[k] for k in (0, 2, 4, 6))
        breaks = sum(not kept[k] and kept[k - 1] for k in range(8))
        return sides >= 2 and breaks <= 1

    def _ways(self) -> tuple[tuple[int, ...], ...]:
        """Cells that each of the four moves leads to from each cell."""
        ways = [[NOWHERE] * self.size for _ in range(4)]
        for cell, letter in enumerate(self.text):
            for move, end in enumerate(self.beside(cell)):
                if letter not in CLOSED and end != NOWHERE and self.text[end] not in CLOSED:
                    ways[move][cell] = end
        return tuple(map(tuple, ways))

    def _spread(self, goals: NDArray[np.bool_]) -> NDArray[np.int16]:
        """Returns distances to all goals at once: in a round every front moves on by one cell."""
        shape = (len(goals), self.height, self.width)
        is_open = np.array([letter not in CLOSED for letter in self.text]).reshape(shape[1:])
        front = goals.reshape(shape)
        found: NDArray[np.int16] = np.full(shape, FAR, np.int16)
        moves = 0
        while front.any():
            found[front] = moves
            moves += 1
            ahead = np.zeros_like(front)
            ahead[:, 1:] |= front[:, :-1]
            ahead[:, :-1] |= front[:, 1:]
            ahead[:, :, 1:] |= front[:, :, :-1]
            ahead[:, :, :-1] |= front[:, :, 1:]
            front = ahead & is_open & (found == FAR)
        return found.reshape(len(goals), self.size)

    def _check_text(self) -> None:
        """Requires a rectangle of known letters, not too large."""
        widths = {len(row) for row in self.rows}
        strange = sorted(set("".join(self.rows)) - set(LETTERS))
        if len(widths) == 1 and not strange and 0 < max(self.height, self.width) <= LONGEST:
            return
        raise SpecError(
            f"the layout {self.name!r} can't be read",
            where="layout",
            expected=f"rows of one length, at most {LONGEST} by {LONGEST}, of {' '.join(LETTERS)}",
            actual=f"the letters {''.join(strange)!r}" if strange else f"rows of {sorted(widths)}",
            fix="write the layout as rows of equal length, of these letters",
        )

    def _check_reach(self) -> None:
        """Requires a cell of each kind, and a way from every place to every other."""
        for kind, noun in NEEDED.items():
            if kind not in self.text:
                raise self._unfit(f"has no {noun}", f"one {kind!r} or more")
        if not self.floors:
            raise self._unfit("has no floor to start on", f"one {FLOOR!r} or more")
        ways = self.distances(DOCK)[0]
        for cell, letter in enumerate(self.text):
            if letter not in CLOSED and ways[cell] == FAR:
                raise self._unfit("is in parts", "a way from every cell to every other")
        for number, cell in enumerate(self.shelves):
            if self.distances(SHELF)[number, self.docks[0]] == FAR:
                raise self._unfit(
                    f"has a shelf that no robot reaches, cell {cell}", "a cell beside"
                )

    def _unfit(self, fault: str, expected: str) -> SpecError:
        return SpecError(
            f"the layout {self.name!r} {fault}",
            where="layout",
            expected=expected,
            actual=" / ".join(self.rows)[:200],
            fix="change the layout's text",
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> FloorLayout:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return (_rebuilt, (self.rows, self.name))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FloorLayout) and self.rows == other.rows

    def __hash__(self) -> int:
        return hash(self.rows)

    def __repr__(self) -> str:
        return f"Layout({self.name!r}, {self.width} by {self.height})"


def layout_of(choice: object) -> FloorLayout:
    """Returns the layout of a name, or of rows of text.

    Raises:
        SpecError: there is none of that name, or the text is no layout.
    """
    if isinstance(choice, FloorLayout):
        return choice
    if isinstance(choice, str):
        if choice == "hall" or choice in NAMED:
            return _named(choice)
        known = [*NAMED, "hall"]
        raise SpecError(
            f"there is no layout called {choice!r}{nearest(choice, known)}",
            where="layout",
            expected=", ".join(known) + ", or rows of text",
            actual=repr(choice)[:200],
            fix=f"layout={known[0]!r}, or rows of text",
        )
    if isinstance(choice, list | tuple) and all(isinstance(row, str) for row in choice):
        return FloorLayout(tuple(choice))
    raise SpecError(
        "a layout is neither a name nor rows of text",
        where="layout",
        expected=f"{', '.join(NAMED)}, hall, or a list of texts",
        actual=repr(choice)[:200],
        fix="layout='small', or rows of text",
    )


@cache
def _named(name: str) -> FloorLayout:
    """Returns a layout of ours, read once: it never changes."""
    return FloorLayout(_hall(*HALL) if name == "hall" else NAMED[name], name=name)


def _rebuilt(rows: tuple[str, ...], name: str) -> FloorLayout:
    """Returns a layout out of a pickle; ours by name, so that distances are worked out once."""
    known = name == "hall" or name in NAMED
    return _named(name) if known and _named(name).rows == rows else FloorLayout(rows, name=name)


def _hall(columns: int, rows: int) -> tuple[str, ...]:
    """Shelves in pairs of rows with two lanes between, then hand-over cells, then docks."""
    shelf = [FLOOR if x % 8 in (0, 7) else SHELF for x in range(columns)]
    hand_over = [HAND_OVER if x % 3 == 1 else FLOOR for x in range(columns)]
    dock = [DOCK if x % 3 == 1 else FLOOR for x in range(columns)]
    charger = [CHARGER if x % 2 == 0 else FLOOR for x in range(columns)]
    lines = [shelf if y % 4 in (1, 2) and y < rows - 14 else [FLOOR] * columns for y in range(rows)]
    lines[rows - 1], lines[rows - 5] = charger, dock
    lines[rows - 9] = lines[rows - 12] = hand_over
    return tuple("".join(line) for line in lines)


REACH: Final = 2
"""Cells that a robot looks in each direction."""
ROOM: Final = 2 * REACH
"""Cells that a padded row is longer than the floor's."""
KINDS: Final = {".": 0, "#": 1, "s": 5, "h": 2, "d": 3, "c": 4}
"""Kinds of cells, as the state tells them."""
OPEN, WALLED, HANDS_OVER, DOCKS, CHARGES, SHELVES = range(6)
PLACES: Final = (SHELF, HAND_OVER, DOCK, CHARGER)
"""Kinds of places, in the order of their numbers."""
MOST: Final = 10_000
"""The most that a count may be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """Sizes of a warehouse; arguments as of `WarehouseRules`.

    Raises:
        SpecError: a number is out of its range, or the layout has too few cells.
    """

    pickers: int = 3
    carriers: int = 2
    spares: int = 1
    orders: int = 8
    every: int = 8
    battery: int = 60
    layout: FloorLayout

    def __post_init__(self) -> None:
        least = {"pickers": 1, "carriers": 1, "spares": 0, "orders": 1, "every": 1, "battery": 1}
        for name, bound in least.items():
            check_whole(name, getattr(self, name), bound, MOST)
        if self.pickers + self.carriers > len(self.layout.floors) // 2:
            raise SpecError(
                f"the layout {self.layout.name!r} has too few cells for so many robots",
                where="pickers, carriers",
                expected=f"at most {len(self.layout.floors) // 2}: half of its floor cells",
                actual=str(self.pickers + self.carriers),
                fix="take fewer robots, or layout='hall'",
            )

    @property
    def roles(self) -> dict[str, str]:
        """By robot, in the order of their numbers, its role: pickers, then carriers."""
        return {
            f"{role}_{i}": role
            for role, count in (("picker", self.pickers), ("carrier", self.carriers))
            for i in range(count + self.spares)
        }


def sizes_of(*, layout: object = "small", **numbers: int) -> Sizes:
    """Returns the sizes of a warehouse with the layout of a name, or of rows of text."""
    return Sizes(layout=layout_of(layout), **numbers)


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


def tables_of(sizes: Sizes, floor: FloorLayout, *, horizon: int | None) -> NDArray[Any]:
    """Returns the numbers that all copies share, an array of one record.

    Places are numbered through: shelves, hand-over cells, docks, chargers, each in reading order.

    Args:
        floor: the layout, or another one with as many cells and places of each kind.
        horizon: ticks.
    """
    by_kind = [floor.cells_of(kind) for kind in PLACES]
    number = np.full(floor.size, NOWHERE, np.int16)
    for own in by_kind:
        number[list(own)] = range(len(own))
    kinds = np.array([KINDS[letter] for letter in floor.text], np.int8)
    seen = np.where(kinds == SHELVES, KINDS[WALL], kinds).reshape(floor.height, floor.width)
    ends = np.cumsum([len(own) for own in by_kind]).tolist()
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
        "places": np.concatenate(by_kind).astype(np.int16),
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


def _shelves_beside(floor: FloorLayout, number: NDArray[np.int16]) -> NDArray[np.int16]:
    """[cells, 4] numbers of the shelves north, east, south, west of an open cell, or NOWHERE."""
    found = np.full((floor.size, 4), NOWHERE, np.int16)
    for cell, letter in enumerate(floor.text):
        for side, near in enumerate(floor.beside(cell) if letter not in CLOSED else ()):
            if near != NOWHERE and floor.text[near] == SHELF:
                found[cell, side] = number[near]
    return found
