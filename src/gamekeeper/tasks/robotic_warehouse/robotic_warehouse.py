"""Robots fetch shelves to a goal and bring them back: RWARE, the robotic warehouse, as a kernel.

Floor
    R1. Cells are highways, shelves' places or goals (which are highways). An episode begins with
        every shelf in its place, robots in different random cells with random directions, and
        `request_queue_size` shelves requested.
    R2. A robot stands on a shelf's cell, loaded with it or under it; two robots never share a cell.
Actions, of all at once
    R3. 0 does nothing, 1 goes forward, 2 turns left, 3 turns right, 4 takes the shelf of the cell,
        or puts down what it carries; it can't put down on a highway.
    R4. Forward into a wall goes nowhere. A loaded robot doesn't go where a shelf stands, unless
        that one is being carried.
    R5. Robots that go forward form chains. A ring of three or more moves; two that would swap
        don't. Nobody follows one that stays. Of the chains that lead to one free cell the longest
        moves; where two meet, that with more robots behind it goes first.
    R6. Of equally long chains, that of the robot with the lowest number at the meeting place goes
        first. (The source leaves it to the order of a set, which isn't part of its rules.)
Deliveries, after all have moved
    R7. Goals are served in their order. A requested shelf on a goal is delivered: another shelf is
        requested in its place, drawn from those that aren't.
    R8. A delivery pays by `reward_type`: `individual`, 1 to the robot that carries the shelf
        ("delivery"); `global`, 1 to each robot ("team_delivery"); `two_stage`, 0.5 to the robot
        that carries it ("delivery") and 0.5 once it put a shelf back in a place ("put_back").
Observation
    R9. A robot knows its x and y (parts of the floor with `normalised_coordinates`), whether it is
        loaded, its direction (up, down, left, right), whether it is on a highway; and of each cell
        at most `sensor_range` away, row by row: whether a robot is there and its direction (up
        where there is none), whether a shelf is there, whether that is requested.
Ends
    R10. After `max_inactivity_steps` ticks without a delivery all are terminated ("inactivity").
    R11. After `max_steps` ticks all are truncated ("horizon"). (The source says terminated.)

Source: Papoudakis et al. 2021, "Benchmarking Multi-Agent Deep Reinforcement Learning Algorithms in
Cooperative Tasks"; rules of the package rware 2.0.0, equal step by step but for R6 and R11, without
messages and image observations.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.errors import check_choice
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import KernelTicks
from gamekeeper.tasks import drawing
from gamekeeper.tasks.arguments import NEVER, check_whole
from gamekeeper.tasks.drawing import Canvas, Pictured, metadata_of
from gamekeeper.tasks.robotic_warehouse import robotic_warehouse_rules as rules
from gamekeeper.tasks.robotic_warehouse.robotic_warehouse_floor import (
    OWN,
    PLACE,
    SENSED,
    Floor,
    floor_of,
    reach,
    tables_of,
)

ARROWS: Final = "^v<>"
LOADED: Final = "AVLR"
SHELVES: Final = ".xX"
NOSE: Final = ((0.42, 0.1), (0.42, 0.74), (0.1, 0.42), (0.74, 0.42))
"""Place of a robot's front in its cell, by direction: left and top, in cells."""


NOOP, FORWARD, LEFT, RIGHT, TOGGLE = range(5)
UP, DOWN, WEST, EAST = range(4)
CLOCKWISE = (UP, EAST, DOWN, WEST)
RESTLESS: Final = 0.05
"""Probability that the reference does anything at all: robots face to face come apart."""
PATIENCE: Final = 0.3
"""Probability that it waits a tick for a robot ahead, and doesn't go round it."""


def reference(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Fetches the nearest requested shelf, delivers it and puts it back; makes room for others."""
    if rng.random() < RESTLESS:
        return int(rng.integers(FORWARD, TOGGLE))
    return _fetch(observation, info, rng, patience=PATIENCE)


def greedy(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """As the reference, straight on: robots that meet stand before each other for good."""
    return _fetch(observation, info, rng, patience=1.0)


def lazy(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Does nothing."""
    return NOOP


def _fetch(
    observation: NDArray[np.float32], info: Mapping[str, Any], rng: Generator, *, patience: float
) -> int:
    """Next action of a robot; `patience`: probability of waiting for another one ahead."""
    is_loaded, is_on_highway = observation[2] > 0, observation[7] > 0
    cells = observation[OWN:].reshape(-1, SENSED)
    is_wanted = cells[len(cells) // 2, 6] > 0
    if (is_wanted and not is_loaded) or (is_loaded and not is_wanted and not is_on_highway):
        return TOGGLE
    if not is_loaded:
        wished = _ways(info["to_request"])
    elif is_wanted:
        wished = _ways(info["to_goal"])[::-1]
    else:
        wished = _ways(info["to_door"] if info["to_door"].any() else info["to_place"])
    sides = [WEST, EAST] if rng.random() < 0.5 else [EAST, WEST]
    waits = rng.random() < patience
    facing = int(observation[3:7].argmax())
    for way in [*wished, *sides, DOWN, UP]:
        if _is_free(observation, way, waits=waits):
            return _turn(facing, way)
    return NOOP


def _ways(offset: Any) -> list[int]:
    """The directions in which a cell lies, across before along."""
    right, down = int(offset[0]), int(offset[1])
    return [EAST if right > 0 else WEST] * bool(right) + [DOWN if down > 0 else UP] * bool(down)


def _is_free(observation: NDArray[np.float32], way: int, *, waits: bool) -> bool:
    """Tells whether a robot may go there: loaded it can't go under shelves."""
    cells = observation[OWN:].reshape(-1, SENSED)
    side = round(len(cells) ** 0.5)
    cell = cells[len(cells) // 2 + {UP: -side, DOWN: side, WEST: -1, EAST: 1}[way]]
    has_robot, has_shelf = cell[0] > 0, cell[5] > 0
    if has_robot:  # with what it carries it may move on
        return waits
    return not (observation[2] > 0 and has_shelf)


def _turn(facing: int, way: int) -> int:
    """The action that brings a robot nearer to going that way."""
    turns = (CLOCKWISE.index(way) - CLOCKWISE.index(facing)) % 4
    return (FORWARD, RIGHT, RIGHT, LEFT)[turns]


REWARDS: Final = {
    "individual": rules.INDIVIDUAL,
    "global": rules.GLOBAL,
    "two_stage": rules.TWO_STAGE,
}
INFO: Final = (
    ("delivered", "i8"),
    ("to_request", "i8", (2,)),
    ("to_goal", "i8", (2,)),
    ("to_place", "i8", (2,)),
    ("to_door", "i8", (2,)),
)
"""Fields of an agent's info; the last four are rows and columns from it to the nearest."""

TERMS: Final = {
    "individual": ("delivery",),
    "global": ("team_delivery",),
    "two_stage": ("delivery", "put_back"),
}


def _state(n_agents: int, size: int) -> list[tuple[Any, ...]]:
    """Fields of the kernel's state over `size` cells: name, dtype, shape; no wider than needed."""
    short = "i2" if size < 1 << 15 else "i4"
    number = "i1" if n_agents < 1 << 7 else short
    robots, cells = (n_agents,), (size,)
    return [
        ("idle", "i4"),
        ("delivered", "i4"),
        ("cell", short, robots),
        ("to", short, robots),
        ("behind", short, robots),
        ("facing", "i1", robots),
        ("load", "i1", robots),
        ("owed", "i1", robots),
        ("codes", "i1", cells),
        ("robots", number, cells),
        ("claims", number, cells),
    ]


def robotic_warehouse_kernel(
    *,
    layout: str = "tiny",
    n_agents: int = 2,
    sensor_range: int = 1,
    request_queue_size: int | None = None,
    max_inactivity_steps: int | None = None,
    max_steps: int | None = 500,
    reward_type: str = "individual",
    normalised_coordinates: bool = False,
    shelf_rows: int | None = None,
    shelf_columns: int | None = None,
    column_height: int = 8,
) -> Kernel:
    """The warehouse as a kernel; arguments as of `RoboticWarehouse`."""
    floor = floor_of(
        layout, shelf_rows=shelf_rows, shelf_columns=shelf_columns, column_height=column_height
    )
    requests = n_agents if request_queue_size is None else request_queue_size
    _check(floor, n_agents, sensor_range, requests, reward_type, max_inactivity_steps, max_steps)
    numbers = OWN + SENSED * (2 * sensor_range + 1) ** 2
    seen = np.ones(numbers, np.float32)
    if not normalised_coordinates:
        seen[:2] = floor.columns - 1, floor.rows - 1
    tables = tables_of(
        floor,
        margin=sensor_range,
        requests=requests,
        inactivity=max_inactivity_steps or 0,
        pays=REWARDS[reward_type],
        is_scaled=normalised_coordinates,
    )
    return Kernel(
        name="robotic_warehouse_v0",
        agents=[f"robot_{i}" for i in range(n_agents)],
        observation_space=Box(np.zeros_like(seen), seen, dtype=np.float32),
        action_space=Discrete(5),
        state=_state(n_agents, reach(floor, sensor_range)),
        reset=rules.reset,
        step=rules.step,
        observe=rules.observe,
        inform=rules.inform,
        info=INFO,
        overview=rules.overview,
        state_space=Box(0, max(4, n_agents), (4, floor.rows, floor.columns), np.int32),
        tables=tables,
        terms=TERMS[reward_type],
        endings=("inactivity",),
        horizon=max_steps or NEVER,
    )


def _check(
    floor: Floor,
    n_agents: int,
    sensor_range: int,
    requests: int,
    reward_type: str,
    max_inactivity_steps: int | None,
    max_steps: int | None,
) -> None:
    cells = floor.rows * floor.columns
    limits = {
        "n_agents": (n_agents, 1, cells),
        "sensor_range": (sensor_range, 1, cells),
        "request_queue_size": (requests, 1, floor.shelves - 1),
        "max_inactivity_steps": (max_inactivity_steps or 1, 1, NEVER),
        "max_steps": (max_steps or 1, 1, NEVER),
    }
    for name, (number, low, high) in limits.items():
        check_whole(name, number, low, high)
    check_choice(reward_type, REWARDS, "there is no such reward", where="reward_type")


class RoboticWarehouse(Pictured, KernelTicks):
    """Each robot sees [8 + 7 (2 sensor_range + 1)^2] float32 numbers (R9); actions are 0 to 4.

    Arguments are named as rware's.

    Args:
        layout: `tiny`, `small`, `medium`, `large`, or rows of text: `x` a shelf's place, `.` a
            highway, `g` a goal.
        n_agents: robots.
        sensor_range: how far they see, in cells.
        request_queue_size: how many shelves are requested at a time, fewer than there are; None:
            as many as robots.
        max_inactivity_steps: ticks without a delivery that end an episode; None: none do.
        max_steps: ticks after which an episode is cut; None: never.
        reward_type: `individual`, `global` or `two_stage` (R8).
        normalised_coordinates: robots know their place as parts of the floor.
        shelf_rows, shelf_columns: blocks of shelves, in place of those of the layout's name.
        column_height: cells of a block.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints.
    Raises:
        SpecError: the floor can't be read, or a number doesn't fit it.
    """

    metadata = metadata_of("robotic_warehouse_v0", fps=10)
    contract = "robotic_warehouse.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so

    def __init__(
        self, *, render_mode: str | None = None, debug: bool = False, **arguments: Any
    ) -> None:
        kernel = robotic_warehouse_kernel(**arguments)
        super().__init__(kernel, render_mode=render_mode, debug=debug)

    def letters(self) -> str:
        """Floor in letters.

        `^ v < >` a robot, `A V L R` a loaded one, `x` shelf, `X` requested shelf, `_` a place
        without its shelf, `g` goal.
        """
        _, facing, loads, shelves = self.state()
        places, goals = self._drawn()
        empty = np.where(goals, "g", np.where(places, "_", "."))
        letters = np.where(shelves > 0, np.take(list(SHELVES), shelves), empty)
        robots = np.where(
            loads > 0, np.take(list(LOADED), facing - 1), np.take(list(ARROWS), facing - 1)
        )
        return drawing.text_of(np.where(facing > 0, robots, letters))

    def pixels(self) -> NDArray[np.uint8]:
        """Floor in cells of 24 pixels, [24 rows, 24 columns, 3]."""
        robots, facing, loads, shelves = self.state()
        places, goals = self._drawn()
        canvas = Canvas(*robots.shape[::-1])
        for y, x in np.argwhere(places | goals):
            canvas.fill(x, y, drawing.GREEN if goals[y, x] else (226, 221, 211), inset=0.04)
        for y, x in np.argwhere(shelves > 0):
            canvas.fill(x, y, drawing.RED if shelves[y, x] == 2 else drawing.WOOD, inset=0.12)
        for y, x in np.argwhere(robots > 0):
            canvas.disc(x, y, drawing.ORANGE if loads[y, x] else drawing.BLUE, radius=0.32)
            left, top = NOSE[facing[y, x] - 1]
            canvas.rectangle(x + left, y + top, 0.16, 0.16, drawing.INK)
        return canvas.pixels

    def _drawn(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Flags of the shelves' places and of the goals, by row and column."""
        t, shape = self.tables[0], self.state_space.shape[1:]
        cells = t["cells"].reshape(shape)
        return t["floor"][cells] == PLACE, np.isin(cells, t["goals"])
