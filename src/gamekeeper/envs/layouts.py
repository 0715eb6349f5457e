"""Floors of a warehouse: where shelves, hand-over cells, docks and chargers are, and how far.

A layout is text, a letter a cell: `.` floor, `#` wall, `s` shelf, `h` hand-over cell, `d` dock,
`c` charger. Robots drive on all but walls and shelves. Cells are numbered in reading order.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.stream import Stream
from gamekeeper.errors import SpecError
from gamekeeper.game.opening.construct import nearest

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


class Layout:
    """A floor that robots can work on; it never changes, so copies of it are itself.

    Attributes:
        name: what it is called.
        rows: its text.
        shelves, hand_overs, docks, chargers, floors: the cells of each kind, in reading order.
        ways: by move 0 to 3 (north, east, south, west) and cell, the cell that it leads to, or
            NOWHERE.
    """

    def __init__(self, rows: tuple[str, ...], *, name: str = "custom") -> None:
        """Reads the text.

        Raises:
            SpecError: it isn't a rectangle of these letters, something is missing, or a place can't
                be reached.
        """
        self.rows, self.name = tuple(rows), name
        self.height, self.width = len(self.rows), len(self.rows[0]) if self.rows else 0
        self._check_text()
        text = "".join(self.rows)
        self.text = text
        self.shelves, self.hand_overs, self.docks, self.chargers, self.floors = (
            tuple(cell for cell, letter in enumerate(text) if letter == kind)
            for kind in (SHELF, HAND_OVER, DOCK, CHARGER, FLOOR)
        )
        self.ways = self._ways()
        self._fields: dict[str, NDArray[np.int16]] = {}
        self._check_reach()

    @property
    def size(self) -> int:
        """How many cells it has."""
        return self.width * self.height

    def beside(self, cell: int) -> list[int]:
        """The cells north, east, south and west of one, NOWHERE outside; shelves too."""
        x, y = cell % self.width, cell // self.width
        around = ((x, y - 1), (x + 1, y), (x, y + 1), (x - 1, y))
        inside = (0 <= i < self.width and 0 <= j < self.height for i, j in around)
        return [
            j * self.width + i if is_in else NOWHERE
            for (i, j), is_in in zip(around, inside, strict=True)
        ]

    def distances(self, kind: str) -> NDArray[np.int16]:
        """[cells of the kind, cells] moves from each cell to each; to beside it for shelves.

        Worked out when it is first asked for; FAR from walls and shelves.
        """
        if kind not in self._fields:
            cells = [cell for cell, letter in enumerate(self.text) if letter == kind]
            goals = np.zeros((len(cells), self.size), dtype=bool)
            for number, cell in enumerate(cells):
                ends = self.beside(cell) if kind == SHELF else [cell]
                for end in ends:
                    if end != NOWHERE and self.text[end] not in CLOSED:
                        goals[number, end] = True
            self._fields[kind] = self._spread(goals)
        return self._fields[kind]

    def shuffled(self, rng: Stream) -> Layout:
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
                return Layout(rows, name=f"{self.name}, shuffled")
            except SpecError:
                continue
        raise SpecError(
            f"the layout {self.name!r} is too crowded to shuffle",
            where="held_out",
            expected="room for every shelf to be reached",
            seen=f"{counts[SHELF]} shelves on {self.size} cells",
        )

    def _parts_nothing(self, letters: list[str], cell: int) -> bool:
        """Whether the open cells around one stay joined around it once it is closed."""
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
        """Where each of the four moves leads from each cell."""
        around = [
            self.beside(cell) if letter not in CLOSED else [NOWHERE] * 4
            for cell, letter in enumerate(self.text)
        ]
        return tuple(
            tuple(
                one[move]
                if one[move] != NOWHERE and self.text[one[move]] not in CLOSED
                else NOWHERE
                for one in around
            )
            for move in range(4)
        )

    def _spread(self, goals: NDArray[np.bool_]) -> NDArray[np.int16]:
        """Distances from all cells at once: in each round every front moves on by one cell."""
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
        """A rectangle of known letters, not too large."""
        widths = {len(row) for row in self.rows}
        strange = sorted(set("".join(self.rows)) - set(LETTERS))
        if len(widths) == 1 and not strange and 0 < max(self.height, self.width) <= LONGEST:
            return
        raise SpecError(
            f"the layout {self.name!r} can't be read",
            where="layout",
            expected=f"rows of one length, at most {LONGEST} by {LONGEST}, of {' '.join(LETTERS)}",
            seen=f"the letters {''.join(strange)!r}" if strange else f"rows of {sorted(widths)}",
        )

    def _check_reach(self) -> None:
        """There is one of each kind, and every place can be reached from every other."""
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
                raise self._unfit(f"has a shelf that nobody reaches, cell {cell}", "a cell beside")

    def _unfit(self, fault: str, expected: str) -> SpecError:
        return SpecError(
            f"the layout {self.name!r} {fault}",
            where="layout",
            expected=expected,
            seen=" / ".join(self.rows)[:200],
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> Layout:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return (_rebuilt, (self.rows, self.name))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Layout) and self.rows == other.rows

    def __hash__(self) -> int:
        return hash(self.rows)

    def __repr__(self) -> str:
        return f"Layout({self.name!r}, {self.width} by {self.height})"


def layout_of(choice: object) -> Layout:
    """The layout of a name, or of rows of text.

    Raises:
        SpecError: there is none of that name, or the text is no layout.
    """
    if isinstance(choice, Layout):
        return choice
    if isinstance(choice, str):
        if choice == "hall" or choice in NAMED:
            return _named(choice)
        known = [*NAMED, "hall"]
        raise SpecError(
            f"there is no layout called {choice!r}{nearest(choice, known)}",
            where="layout",
            expected=", ".join(known) + ", or rows of text",
            seen=repr(choice)[:200],
        )
    if isinstance(choice, list | tuple) and all(isinstance(row, str) for row in choice):
        return Layout(tuple(choice))
    raise SpecError(
        "a layout is neither a name nor rows of text", where="layout", seen=repr(choice)[:200]
    )


@cache
def _named(name: str) -> Layout:
    """A layout of ours, read once: it never changes."""
    return Layout(_hall(*HALL) if name == "hall" else NAMED[name], name=name)


def _rebuilt(rows: tuple[str, ...], name: str) -> Layout:
    """A layout out of a pickle: ours by name, so that their distances are worked out once."""
    known = name == "hall" or name in NAMED
    return _named(name) if known and _named(name).rows == rows else Layout(rows, name=name)


def _hall(columns: int, rows: int) -> tuple[str, ...]:
    """Shelves in pairs of rows with two lanes between, then hand-over cells, then docks."""
    shelf = [FLOOR if x % 8 in (0, 7) else SHELF for x in range(columns)]
    hand_over = [HAND_OVER if x % 3 == 1 else FLOOR for x in range(columns)]
    dock = [DOCK if x % 3 == 1 else FLOOR for x in range(columns)]
    charger = [CHARGER if x % 2 == 0 else FLOOR for x in range(columns)]
    text = []
    for y in range(rows):
        if y == rows - 1:
            row = charger
        elif y == rows - 5:
            row = dock
        elif y in (rows - 9, rows - 12):
            row = hand_over
        else:
            row = shelf if y % 4 in (1, 2) and y < rows - 14 else [FLOOR] * columns
        text.append("".join(row))
    return tuple(text)
