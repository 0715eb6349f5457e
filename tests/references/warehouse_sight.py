"""What robots of the warehouse written by hand see, laid out as in the task itself."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from gamekeeper.tasks.warehouse.warehouse_floor import (
    CHARGER,
    CLOSED,
    DOCK,
    FAR,
    HAND_OVER,
    NOWHERE,
    SHELF,
    FloorLayout,
)

if TYPE_CHECKING:
    from tests.references.warehouse import WarehouseRules

OWN: Final = 6
PLACE: Final = 9
PLACES: Final = 3
"""Two goals and a charger."""
REACH: Final = 2
"""Cells that a robot looks in each direction."""
SIDE: Final = 2 * REACH + 1
KINDS_AT: Final = OWN + PLACE * PLACES
ROBOTS_AT: Final = KINDS_AT + SIDE * SIDE
LENGTH: Final = ROBOTS_AT + SIDE * SIDE
PICKER, CARRIER = 1, 2
KINDS: Final = {".": 0, "#": 1, "s": 1, "h": 2, "d": 3, "c": 4}
SHELF_KIND: Final = 5
HEADER: Final = 3
PER_ROBOT: Final = 5
MANY: Final = 2**31 - 1

Seeker: TypeAlias = tuple[str, bool]
"""A role, and whether with an item: robots of one kind have the same goals."""
Goals: TypeAlias = tuple[str, NDArray[np.intp], NDArray[np.int16]]
"""Kind of place, numbers of the open ones, and for each of them the two least ways to it."""


class Sight:
    """The eyes of all robots over one episode's floor; looks again after each step.

    Args:
        task: the rules whose state is looked at.
    """

    LENGTH: Final = LENGTH

    def __init__(self, task: WarehouseRules) -> None:
        # What the rules change in place is held, and not the rules: copies of either stay whole.
        self._robots_of, self._stands = task.robots, task.stands
        self._wanted, self._lying = task.wanted, task.lying
        self._battery, self._disturbances = task.battery, task.disturbances
        floor = self._floor = task.floor
        shape = (floor.height, floor.width)
        kinds = np.array([KINDS[letter] for letter in floor.text], np.int16).reshape(shape)
        self._kinds = np.pad(kinds, REACH, constant_values=KINDS["#"])
        self._robots = np.zeros_like(self._kinds)
        numbers = {cell: number for number, cell in enumerate(floor.shelves)}
        self._beside = [
            [numbers[near] for near in floor.beside(cell) if near in numbers]
            if floor.text[cell] not in CLOSED
            else []
            for cell in range(floor.size)
        ]
        self._cells = {
            kind: tuple(cell for cell in range(floor.size) if floor.text[cell] == kind)
            for kind in (SHELF, HAND_OVER, DOCK, CHARGER)
        }
        self._goals: dict[Seeker, Goals | None] = {}
        self._known: dict[str, tuple[Seeker, int]] = {}
        self._seekers: dict[Seeker, dict[str, int]] = {
            (role, is_loaded): {} for role in ("picker", "carrier") for is_loaded in (False, True)
        }
        self.look_again(task.robots)

    @staticmethod
    def space(floor: FloorLayout, battery: int) -> Box:
        """The space of every robot's observations."""
        low, high = np.zeros(LENGTH, np.int16), np.ones(LENGTH, np.int16)
        high[:OWN] = floor.width - 1, floor.height - 1, 1, 1, battery, battery
        for at in range(OWN, KINDS_AT, PLACE):
            low[at + 1 : at + 3] = 1 - floor.width, 1 - floor.height
            high[at + 1 : at + 5] = floor.width - 1, floor.height - 1, floor.size, floor.size
        high[KINDS_AT:ROBOTS_AT] = KINDS["c"]
        high[ROBOTS_AT:] = CARRIER
        return Box(low, high, dtype=np.int16)

    @staticmethod
    def things() -> list[tuple[int, int]]:
        """The parts of an observation that stand for one thing each, and may be hidden."""
        places = [(at, at + PLACE) for at in range(OWN, KINDS_AT, PLACE)]
        return places + [(at, at + 1) for at in range(ROBOTS_AT, LENGTH)]

    def look_again(self, agents: Iterable[str]) -> None:
        """Sees the state anew: only these robots acted, came or went."""
        self._goals.clear()
        width, marks = self._floor.width, self._robots
        for agent in agents:
            if agent in self._known:
                key, cell = self._known.pop(agent)
                del self._seekers[key][agent]
                marks[cell // width + REACH, cell % width + REACH] = 0
        for agent in agents:
            robot = self._robots_of[agent]
            if self._stands.get(robot.cell) == agent:
                y, x = divmod(robot.cell, width)
                marks[y + REACH, x + REACH] = PICKER if robot.role == "picker" else CARRIER
                key = robot.role, robot.load != NOWHERE
                self._known[agent] = key, robot.cell
                self._seekers[key][agent] = robot.cell

    def shelves_beside(self, cell: int) -> list[int]:
        """Numbers of the shelves north, east, south and west of an open cell, in this order."""
        return self._beside[cell]

    def view(self, agent: str) -> NDArray[np.int16]:
        """What a robot sees, but for the knobs of perception; drift is in it."""
        robot, floor = self._robots_of[agent], self._floor
        y, x = divmod(robot.cell, floor.width)
        seen = np.zeros(LENGTH, np.int16)
        if robot.cell == NOWHERE:  # a spare, which nobody has to show anything
            return seen
        window = slice(y, y + SIDE), slice(x, x + SIDE)
        seen[KINDS_AT:ROBOTS_AT] = self._kinds[window].ravel()
        seen[ROBOTS_AT:] = self._robots[window].ravel()
        seen[ROBOTS_AT + SIDE * SIDE // 2] = 0  # itself
        believed = robot.cell
        if self._disturbances is not None:
            east, south = self._disturbances.drift[agent]
            x = min(max(x + east, 0), floor.width - 1)
            y = min(max(y + south, 0), floor.height - 1)
            believed = y * floor.width + x
        lack = self._battery - robot.battery
        seen[:OWN] = x, y, robot.role == "carrier", robot.load != NOWHERE, robot.battery, lack
        self._tell_goals(seen, robot.role, robot.load != NOWHERE, robot.cell, believed)
        self._tell_charger(seen, robot.cell, believed)
        return seen

    def _tell_goals(
        self, seen: NDArray[np.int16], role: str, is_loaded: bool, cell: int, believed: int
    ) -> None:
        """Writes the two nearest goals, and how near the nearest rival is to each."""
        key = (role, is_loaded)
        if key not in self._goals:
            self._goals[key] = self._look_for(*key)
        goals = self._goals[key]
        if goals is None:
            return
        kind, rows, nearest = goals
        ways = self._floor.distances(kind)
        mine, thought = ways[rows, cell], ways[rows, believed]
        for place, index in enumerate(np.argsort(thought, kind="stable")[:2].tolist()):
            rival = nearest[index, int(mine[index] == nearest[index, 0])]
            self._tell(seen, place, kind, int(rows[index]), believed, int(rival))

    def _look_for(self, role: str, is_loaded: bool) -> Goals | None:
        """The goals of a kind of robot, and the two nearest of its kind to each of them."""
        if role == "picker" and not is_loaded:
            kind, rows = SHELF, np.flatnonzero(self._wanted)
        elif role == "carrier" and is_loaded:
            kind, rows = DOCK, np.arange(len(self._floor.docks))
        else:
            kind = HAND_OVER
            lies = [cell in self._lying for cell in self._floor.hand_overs]
            rows = np.flatnonzero(np.array(lies) != (role == "picker"))
        if not len(rows):
            return None
        cells = np.array(list(self._seekers[role, is_loaded].values()), np.intp)
        nearest: NDArray[np.int16] = np.full((len(rows), len(cells) + 2), FAR, np.int16)
        nearest[:, 2:] = self._floor.distances(kind)[rows[:, None], cells]
        return kind, rows, np.partition(nearest, 1, axis=1)[:, :2]

    def _tell_charger(self, seen: NDArray[np.int16], cell: int, believed: int) -> None:
        """Writes the nearest charger without another robot on it, or else the nearest one."""
        ways = self._floor.distances(CHARGER)[:, believed]
        stands = self._stands
        taken = [other != cell and other in stands for other in self._floor.chargers]
        row = int(np.argmin(ways if all(taken) else np.where(taken, np.int16(FAR), ways)))
        self._tell(seen, PLACES - 1, CHARGER, row, believed, 0)

    def _tell(
        self, seen: NDArray[np.int16], place: int, kind: str, row: int, believed: int, rival: int
    ) -> None:
        """Writes one place."""
        floor = self._floor
        at = OWN + place * PLACE
        y, x = divmod(believed, floor.width)
        to_y, to_x = divmod(self._cells[kind][row], floor.width)
        ways = floor.distances(kind)[row]
        moves = int(ways[believed])
        seen[at : at + 5] = 1, to_x - x, to_y - y, min(moves, floor.size), min(rival, floor.size)
        for move in range(4):
            ahead = floor.ways[move][believed]
            if ahead != NOWHERE and ways[ahead] < moves:
                seen[at + 5 + move] = 1


def state_space(task: WarehouseRules) -> Box:
    """The space of the whole state."""
    floor, robots = task.layout, len(task.possible_agents)
    robot = (1, floor.width - 1, floor.height - 1, 1, task.battery)
    kinds, items = [SHELF_KIND] * floor.size, [task.orders] * floor.size
    high = np.array((MANY, task.orders, task.orders, *robot * robots, *kinds, *items), np.int32)
    return Box(np.zeros_like(high), high, dtype=np.int32)


def state_of(task: WarehouseRules) -> NDArray[np.int32]:
    """The whole state; its layout is in the module's docstring."""
    floor = task.floor
    numbers = [min(task.ticks, MANY), len(task.coming), task.delivered]
    for robot in task.robots.values():
        is_there = robot.cell in task.stands and task.robots[task.stands[robot.cell]] is robot
        y, x = divmod(robot.cell, floor.width)
        numbers += (1, x, y, robot.load != NOWHERE, robot.battery) if is_there else [0] * PER_ROBOT
    numbers += [SHELF_KIND if letter == SHELF else KINDS[letter] for letter in floor.text]
    items = [0] * floor.size
    for cell, count in zip(floor.shelves, task.wanted, strict=True):
        items[cell] = count
    for cell in task.lying:
        items[cell] = 1
    return np.array(numbers + items, np.int32)
