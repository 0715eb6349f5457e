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

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from gamekeeper.envs import robotic_warehouse_picture as picture
from gamekeeper.envs.robotic_warehouse_floor import (
    BEYOND,
    HIGHWAY,
    OWN,
    PLACE,
    SENSED,
    Floor,
    floor_of,
    reach,
    tables_of,
)
from gamekeeper.envs.robotic_warehouse_policies import greedy, lazy, reference
from gamekeeper.errors import SpecError
from gamekeeper.kernels import draws
from gamekeeper.kernels.faces import KernelTicks
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.rules import rule

NOOP, FORWARD, LEFT, RIGHT, TOGGLE = range(5)
INDIVIDUAL, GLOBAL, TWO_STAGE = range(3)
REWARDS: Final = {"individual": INDIVIDUAL, "global": GLOBAL, "two_stage": TWO_STAGE}
TERMS: Final = {
    "individual": ("delivery",),
    "global": ("team_delivery",),
    "two_stage": ("delivery", "put_back"),
}
NEVER: Final = 1 << 62
"""More ticks than anybody plays."""
INACTIVITY: Final = 1
"""Which of the endings it is, from 1."""


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shelves in their places, robots and requests anywhere (R1)."""
    for k in range(len(t.homes)):
        s.sight[t.homes[k]] = 5
    for i in range(len(s.cell)):
        cell = t.cells[draws.integers(s, len(t.cells))]
        while s.robots[cell] != 0:
            cell = t.cells[draws.integers(s, len(t.cells))]
        s.robots[cell] = i + 1
        s.cell[i] = cell
        s.to[i] = cell
    for i in range(len(s.cell)):
        s.facing[i] = draws.integers(s, 4)
        s.sight[s.cell[i]] += 1 + s.facing[i]
    for _ in range(t.requests):
        cell = t.homes[draws.integers(s, len(t.homes))]
        while s.sight[cell] >= 10:
            cell = t.homes[draws.integers(s, len(t.homes))]
        s.sight[cell] += 5


@rule
def step(s, t, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """A tick: who goes where, then turns and shelves, then goals (R3 to R11)."""
    if aim(s, t, actions) > 0:
        rank(s)
        move(s)
    for i in range(len(s.cell)):
        if actions[i] == TOGGLE:
            toggle(s, t, i, rewards)
        elif actions[i] == LEFT or actions[i] == RIGHT:
            facing = t.turned[actions[i] - LEFT, s.facing[i]]
            s.sight[s.cell[i]] += facing - s.facing[i]
            s.facing[i] = facing
    s.idle += 1
    for g in range(len(t.goals)):
        if s.sight[t.goals[g]] >= 10:
            deliver(s, t, t.goals[g], rewards)
    if t.inactivity > 0 and s.idle >= t.inactivity:
        for i in range(len(s.cell)):
            terminated[i] = True
            s.ending[i] = INACTIVITY


@rule
def aim(s, t, actions):  # type: ignore[no-untyped-def]  # likewise
    """Writes where each robot would go; how many would go anywhere (R4)."""
    going = 0
    for i in range(len(s.cell)):
        if actions[i] == FORWARD:
            cell = s.cell[i] + t.ahead[s.facing[i]]
            if t.floor[cell] != BEYOND:
                other = s.robots[cell] - 1
                stands = s.sight[cell] >= 5 and not (other >= 0 and s.load[other] != 0)
                if s.load[i] == 0 or not stands:
                    s.to[i] = cell
                    going += 1
    return going


@rule
def rank(s):  # type: ignore[no-untyped-def]  # likewise
    """Claims each cell for the robot with the longest chain behind it (R5, R6).

    `s.behind[i]`: how many robots wait in line behind i. In a ring it is at least as many as the
    robots outside it, because the count goes round until it has reached the number of robots; so
    that a ring's robots claim their cells from any chain that leads into it.
    """
    count = len(s.cell)
    for i in range(count):
        if s.to[i] != s.cell[i]:
            length = 1
            k = s.robots[s.to[i]] - 1
            while k >= 0 and s.to[k] != s.cell[k] and s.behind[k] < length and length < count:
                s.behind[k] = length
                length += 1
                k = s.robots[s.to[k]] - 1
    for i in range(count):
        if s.to[i] != s.cell[i]:
            best = s.claims[s.to[i]] - 1
            if best < 0 or s.behind[best] < s.behind[i]:
                s.claims[s.to[i]] = i + 1


@rule
def goes(s, i):  # type: ignore[no-untyped-def]  # likewise
    """Whether all ahead of robot i go, up to a free cell or round a ring (R5)."""
    k = i
    for length in range(1, len(s.cell) + 1):
        if s.to[k] == s.cell[k] or s.claims[s.to[k]] != k + 1:
            return False
        k = s.robots[s.to[k]] - 1
        if k < 0:
            return True
        if k == i:
            return length != 2
    return False  # into a ring that i isn't part of


@rule
def move(s):  # type: ignore[no-untyped-def]  # likewise
    """Moves who goes, with its shelf; leaves nothing behind in claims and ranks."""
    for i in range(len(s.cell)):
        s.behind[i] = goes(s, i)
    for i in range(len(s.cell)):
        s.claims[s.to[i]] = 0
        if s.behind[i] == 0:
            s.to[i] = s.cell[i]
        else:  # off the floor, with all that moves
            seen = 1 + s.facing[i] if s.load[i] == 0 else s.sight[s.cell[i]]
            s.behind[i] = seen
            s.sight[s.cell[i]] -= seen
            s.robots[s.cell[i]] = 0
    for i in range(len(s.cell)):
        if s.behind[i] > 0:
            s.cell[i] = s.to[i]
            s.sight[s.cell[i]] += s.behind[i]
            s.robots[s.cell[i]] = i + 1
            s.behind[i] = 0


@rule
def toggle(s, t, i, rewards):  # type: ignore[no-untyped-def]  # likewise
    """Robot i takes the shelf over it, or puts down its own (R3, R8)."""
    if s.load[i] == 0:
        if s.sight[s.cell[i]] >= 5:
            s.load[i] = 1
    elif t.floor[s.cell[i]] == PLACE:
        s.load[i] = 0
        if s.owed[i] != 0:
            s.owed[i] = 0
            rewards[i, 1] = 0.5


@rule
def deliver(s, t, goal, rewards):  # type: ignore[no-untyped-def]  # likewise
    """The shelf on a goal is delivered, and another one requested (R7, R8)."""
    s.idle = 0
    s.delivered += 1
    left = draws.integers(s, len(t.homes) - t.requests)
    for c in range(len(s.sight)):
        if 5 <= s.sight[c] < 10:
            if left == 0:
                s.sight[c] += 5
                break
            left -= 1
    s.sight[goal] -= 5
    i = s.robots[goal] - 1
    if t.pays == INDIVIDUAL:
        rewards[i, 0] += 1.0
    elif t.pays == TWO_STAGE:
        s.owed[i] = 1
        rewards[i, 0] += 0.5
    else:
        for k in range(len(s.cell)):
            rewards[k, 0] += 1.0


@rule
def observe(s, t, obs):  # type: ignore[no-untyped-def]  # likewise
    """What robots know of themselves and sense around them (R9)."""
    for i in range(len(s.cell)):
        cell = s.cell[i]
        at = OWN + SENSED * len(t.around)
        for k in range(len(t.around) - 1, -1, -1):
            at -= SENSED
            sense(t, s.sight[cell + t.around[k]], obs, i, at - 1)
        obs[i, 0] = t.own[cell, 0]
        obs[i, 1] = t.own[cell, 1]
        obs[i, 2] = s.load[i]
        for d in range(4):
            obs[i, 3 + d] = s.facing[i] == d
        obs[i, 7] = t.own[cell, 2]


@rule
def sense(t, code, obs, i, at):  # type: ignore[no-untyped-def]  # likewise
    """Writes what a cell looks like, and a zero before it, where what is written next belongs.

    Eight numbers, all read before any is written, compile to one load and one store; seven in a
    loop take twice as long.
    """
    a, b, c, d = t.look[code, 0], t.look[code, 1], t.look[code, 2], t.look[code, 3]
    e, f, g, h = t.look[code, 4], t.look[code, 5], t.look[code, 6], t.look[code, 7]
    obs[i, at], obs[i, at + 1], obs[i, at + 2], obs[i, at + 3] = a, b, c, d
    obs[i, at + 4], obs[i, at + 5], obs[i, at + 6], obs[i, at + 7] = e, f, g, h


@rule
def inform(s, t, infos):  # type: ignore[no-untyped-def]  # likewise
    """How many shelves were delivered, and (right, down) to what is nearest of each kind.

    0, 0 where there is none: of requested shelves that nobody carries, of goals, of empty places;
    and of the highway beside that place.
    """
    for i in range(len(s.cell)):
        infos[i].delivered = s.delivered
        best, far = -1, NEVER
        for k in range(len(t.cells)):
            c = t.cells[k]
            is_carried = s.robots[c] > 0 and s.load[s.robots[c] - 1] != 0
            if s.sight[c] >= 10 and not is_carried and steps_to(s, t, i, c) < far:
                best, far = c, steps_to(s, t, i, c)
        point(s, t, i, best, infos[i].to_request)
        best, far = -1, NEVER
        for k in range(len(t.goals)):
            if steps_to(s, t, i, t.goals[k]) < far:
                best, far = t.goals[k], steps_to(s, t, i, t.goals[k])
        point(s, t, i, best, infos[i].to_goal)
        best, far = -1, NEVER
        for k in range(len(t.homes)):
            c = t.homes[k]
            if s.sight[c] < 5 and steps_to(s, t, i, c) < far:
                best, far = c, steps_to(s, t, i, c)
        point(s, t, i, best, infos[i].to_place)
        if best >= 0:
            best = best - 1 if t.floor[best - 1] == HIGHWAY else best + 1
        point(s, t, i, best, infos[i].to_door)


@rule
def steps_to(s, t, i, cell):  # type: ignore[no-untyped-def]  # likewise
    """Steps from robot i to a cell, as if nothing stood between them."""
    width = t.ahead[1]
    here = s.cell[i]
    return abs(cell % width - here % width) + abs(cell // width - here // width)


@rule
def point(s, t, i, cell, offset):  # type: ignore[no-untyped-def]  # likewise
    """Writes how far right and down of robot i a cell lies; 0, 0 of no cell (-1)."""
    width = t.ahead[1]
    here = s.cell[i]
    offset[0] = cell % width - here % width if cell >= 0 else 0
    offset[1] = cell // width - here // width if cell >= 0 else 0


@rule
def overview(s, t, state):  # type: ignore[no-untyped-def]  # likewise
    """By cell: robot, its direction, loaded, shelf (2: requested)."""
    columns = state.shape[2]
    for i in range(len(t.cells)):
        cell = t.cells[i]
        y, x = i // columns, i % columns
        robot = s.robots[cell]
        state[0, y, x] = robot
        state[1, y, x] = s.facing[robot - 1] + 1 if robot > 0 else 0
        state[2, y, x] = s.load[robot - 1] if robot > 0 else 0
        state[3, y, x] = s.sight[cell] // 5


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
    size = reach(floor, sensor_range)
    short = "i2" if size < 1 << 15 else "i4"
    number = "i1" if n_agents < 1 << 7 else short
    robots, cells = (n_agents,), (size,)
    numbers = OWN + SENSED * (2 * sensor_range + 1) ** 2
    seen = np.ones(numbers, np.float32)
    if not normalised_coordinates:
        seen[:2] = floor.columns - 1, floor.rows - 1
    return Kernel(
        name="robotic_warehouse_v0",
        agents=[f"robot_{i}" for i in range(n_agents)],
        observation_space=Box(np.zeros_like(seen), seen, dtype=np.float32),
        action_space=Discrete(5),
        state=[
            ("idle", "i4"), ("delivered", "i4"), ("cell", short, robots), ("to", short, robots),
            ("behind", short, robots), ("facing", "i1", robots), ("load", "i1", robots),
            ("owed", "i1", robots), ("sight", "i1", cells), ("robots", number, cells),
            ("claims", number, cells),
        ],
        reset=reset,
        step=step,
        observe=observe,
        inform=inform,
        info=[
            ("delivered", "i8"), ("to_request", "i8", (2,)), ("to_goal", "i8", (2,)),
            ("to_place", "i8", (2,)), ("to_door", "i8", (2,)),
        ],
        overview=overview,
        state_space=Box(0, max(4, n_agents), (4, floor.rows, floor.columns), np.int32),
        tables=tables_of(
            floor, margin=sensor_range, requests=requests, inactivity=max_inactivity_steps or 0,
            pays=REWARDS[reward_type], is_scaled=normalised_coordinates,
        ),
        terms=TERMS[reward_type],
        endings=("inactivity",),
        horizon=max_steps or NEVER,
    )  # fmt: skip


def _check(
    floor: Floor, n_agents: int, sensor_range: int, requests: int, reward_type: str,
    max_inactivity_steps: int | None, max_steps: int | None,
) -> None:  # fmt: skip
    cells = floor.rows * floor.columns
    limits = {
        "n_agents": (n_agents, 1, cells),
        "sensor_range": (sensor_range, 1, cells),
        "request_queue_size": (requests, 1, floor.shelves - 1),
        "max_inactivity_steps": (max_inactivity_steps or 1, 1, NEVER),
        "max_steps": (max_steps or 1, 1, NEVER),
    }
    for name, (number, low, high) in limits.items():
        if type(number) is not int or not low <= number <= high:
            raise SpecError(
                f"{name} doesn't fit the floor",
                where=name,
                expected=f"a whole number from {low} to {high}",
                seen=repr(number),
            )
    if reward_type not in REWARDS:
        raise SpecError(
            "there is no such reward",
            where="reward_type",
            expected=f"one of {', '.join(REWARDS)}",
            seen=repr(reward_type),
        )


_SIZED: Final = re.compile(
    r"rware-(?:(?P<range>\d+)s-)?(?P<layout>tiny|small|medium|large)-(?:(?P<height>\d+)h-)?"
    r"(?P<robots>\d+)ag(?P<rate>-easy|-hard)?-v2"
)
_COUNTED: Final = re.compile(
    r"rware-(?:(?P<range>\d+)s-)?(?P<rows>\d+)x(?P<columns>\d+)-(?P<height>\d+)h-(?P<robots>\d+)ag-"
    r"(?P<requests>\d+)req-(?P<pays>indiv|global|twostage)-v2"
)
_RATES: Final = {"-easy": 2.0, None: 1.0, "-hard": 0.5}
_PAYS: Final = {"indiv": "individual", "global": "global", "twostage": "two_stage"}


def arguments_of(gymnasium_id: str) -> dict[str, Any]:
    """The arguments of the task that rware registers under an id, as `rware-tiny-2ag-hard-v2`.

    Raises:
        SpecError: it registers none, or one with image observations.
    Source: `rware/__init__.py`, rware 2.0.0.
    """
    if found := _SIZED.fullmatch(gymnasium_id):
        robots = int(found["robots"])
        told = {
            "layout": found["layout"],
            "request_queue_size": int(robots * _RATES[found["rate"]]),
        }
    elif found := _COUNTED.fullmatch(gymnasium_id):
        robots = int(found["robots"])
        told = {
            "shelf_rows": int(found["rows"]), "shelf_columns": int(found["columns"]),
            "request_queue_size": int(found["requests"]), "reward_type": _PAYS[found["pays"]],
        }  # fmt: skip
    else:
        raise SpecError(
            "rware has no such environment with flattened observations",
            where="gymnasium_id",
            expected="as rware-tiny-2ag-v2 or rware-2x3-8h-4ag-4req-indiv-v2",
            seen=repr(gymnasium_id),
        )
    return {
        **told, "n_agents": robots, "sensor_range": int(found["range"] or 1),
        "column_height": int(found["height"] or 8),
    }  # fmt: skip


class RoboticWarehouse(KernelTicks):
    """Each robot sees [8 + 7 (2 sensor_range + 1)^2] float32 numbers (R9); actions are 0 to 4.

    Arguments are named as rware's; `RoboticWarehouse(**arguments_of("rware-tiny-2ag-v2"))` is what
    Gymnasium makes of that id.

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

    metadata = {  # noqa: RUF012  # PettingZoo declares it so
        "name": "robotic_warehouse_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }
    contract = "robotic_warehouse.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012
    not_batched = ""

    def __init__(
        self, *, render_mode: str | None = None, debug: bool = False, **arguments: Any
    ) -> None:
        kernel = robotic_warehouse_kernel(**arguments)
        super().__init__(kernel, render_mode=render_mode, debug=debug)

    def render(self) -> str | NDArray[np.uint8] | None:
        """The floor in letters, or in cells of 24 pixels, [24 rows, 24 columns, 3]."""
        if self.render_mode is None:
            return None
        return picture.draw(self.state(), self.tables[0], is_text=self.render_mode == "ansi")
