"""Observations of warehouse robots, and the state: flat whole numbers, laid out here.

An observation, [LENGTH] int16:

    0 x, 1 y      where the robot believes it is
    2 role        0 picker, 1 carrier
    3 load        1 with an item
    4 battery     units left
    5 lack        units that are missing to a full battery
    6..           three places of 9 numbers each: the nearest and second nearest goal, a charger
    33..          the 5 by 5 cells around it: kinds (0 open floor, 1 closed or outside, 2 hand-over
                  cell, 3 dock, 4 charger), then robots (0 none, 1 picker, 2 carrier), row by row

Goals are, for a picker, shelves with open orders, then hand-over cells without an item; for a
carrier, hand-over cells with an item, then docks. The charger is the nearest one without another
robot on it, or the nearest one where there is none. A place is told as

    0 present     1, or 0 and nothing but zeros after it
    1 east, 2 south   cells to it (to the shelf itself, to the east and to the south)
    3 moves       length of the shortest way to it (to a cell beside a shelf)
    4 rival       the same for the nearest other robot that has goals of this kind; for a charger 0
    5..8          1 where a move north, east, south, west shortens the way

The state, int32: tick, orders to come, orders delivered; for each possible agent whether it is on
the floor, x, y, whether it has an item, battery; for each cell its kind (as above, 5 for a shelf);
for each cell the open orders of a shelf, or the item lying there.
"""

from typing import Final

import numpy as np
from gymnasium.spaces import Box

from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.tasks.warehouse.warehouse_floor import (
    CHARGES,
    FAR,
    NOWHERE,
    REACH,
    ROOM,
    SHELVES,
    FloorLayout,
    Sizes,
)
from gamekeeper.tasks.warehouse.warehouse_rules import (
    ACTIONS,
    CARRIER,
    HANDLE,
    NOOP,
    can_handle,
    is_there,
    padded,
)

OWN: Final = 6
PLACE: Final = 9
PLACES: Final = 3
"""Two goals and a charger."""
SIDE: Final = 2 * REACH + 1
KINDS_AT: Final = OWN + PLACE * PLACES
ROBOTS_AT: Final = KINDS_AT + SIDE * SIDE
LENGTH: Final = ROBOTS_AT + SIDE * SIDE
CENTRE: Final = SIDE * SIDE // 2
HEADER: Final = 3
PER_ROBOT: Final = 5
MANY: Final = 2**31 - 1
THINGS: Final = (
    *((at, at + PLACE) for at in range(OWN, KINDS_AT, PLACE)),
    *((at, at + 1) for at in range(ROBOTS_AT, LENGTH)),
)
"""The parts of an observation that stand for one thing each, and may be hidden."""


def seen_space(floor: FloorLayout, battery: int) -> Box:
    """The space of every robot's observations."""
    low, high = np.zeros(LENGTH, np.int16), np.ones(LENGTH, np.int16)
    high[:OWN] = floor.width - 1, floor.height - 1, 1, 1, battery, battery
    for at in range(OWN, KINDS_AT, PLACE):
        low[at + 1 : at + 3] = 1 - floor.width, 1 - floor.height
        high[at + 1 : at + 5] = floor.width - 1, floor.height - 1, floor.size, floor.size
    high[KINDS_AT:ROBOTS_AT] = CHARGES
    high[ROBOTS_AT:] = CARRIER
    return Box(low, high, dtype=np.int16)


def state_space(sizes: Sizes) -> Box:
    """The space of the whole state."""
    floor, robots = sizes.layout, len(sizes.roles)
    robot = (1, floor.width - 1, floor.height - 1, 1, sizes.battery)
    kinds, items = [SHELVES] * floor.size, [sizes.orders] * floor.size
    high = np.array((MANY, sizes.orders, sizes.orders, *robot * robots, *kinds, *items), np.int32)
    return Box(np.zeros_like(high), high, dtype=np.int32)


# -- observations


@rule
def observe(s, t, obs):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shows all robots their observations; how near robots are to a goal is found once for all."""
    for goal in range(len(s.near)):
        if is_open(s, t, goal):
            s.near[goal, 0], s.near[goal, 1] = nearest_two(s, t, goal)
    for i in range(len(s.cell)):
        goal, other = look(s, t, i, obs[i])
        for k in range(2):
            if goal != NOWHERE:
                tell_rival(s, t, i, obs[i], k, goal, s.near[goal, 0], s.near[goal, 1])
            goal = other


@rule
def observe_one(s, t, i, seen):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shows one robot its observation."""
    goal, other = look(s, t, i, seen)
    for k in range(2):
        if goal != NOWHERE:
            one, two = nearest_two(s, t, goal)
            tell_rival(s, t, i, seen, k, goal, one, two)
        goal = other


@rule
def look(s, t, i, seen):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shows a robot all but rivals; returns its nearest and second nearest goal."""
    cell = s.cell[i]
    for k in range(KINDS_AT):
        seen[k] = 0
    if cell == NOWHERE:  # a spare, which sees zeros
        for k in range(KINDS_AT, LENGTH):
            seen[k] = 0
        return NOWHERE, NOWHERE
    look_around(s, t, cell, seen)
    width = t.width
    x = min(max(cell % width + s.drift[i, 0], 0), width - 1)
    y = min(max(cell // width + s.drift[i, 1], 0), len(t.kinds) // width - 1)
    believed = y * width + x
    seen[0], seen[1] = x, y
    seen[2] = 0 if i < t.first_carrier else 1
    seen[3] = 0 if s.load[i] == NOWHERE else 1
    seen[4], seen[5] = s.battery[i], t.full - s.battery[i]
    first, second = nearest_goals(s, t, i, believed)
    if first != NOWHERE:
        tell(t, seen, 0, first, believed)
    if second != NOWHERE:
        tell(t, seen, 1, second, believed)
    tell(t, seen, 2, nearest_charger(s, t, cell, believed), believed)
    return first, second


@rule
def look_around(s, t, cell, seen):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shows the cells around a robot."""
    corner = padded(t, cell) - REACH * (t.width + ROOM) - REACH
    for j in range(SIDE):
        row = corner + j * (t.width + ROOM)
        for k in range(SIDE):
            seen[KINDS_AT + j * SIDE + k] = t.seen[row + k]
            seen[ROBOTS_AT + j * SIDE + k] = s.marks[row + k]
    seen[ROBOTS_AT + CENTRE] = 0  # itself


@rule
def is_open(s, t, goal):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """True if a robot may have a goal there: all places but shelves without orders."""
    return goal >= t.hand_overs or s.wanted[goal] > 0


@rule
def goals_of(s, t, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The numbers of the places where a robot's goals are: the first, and one after the last."""
    is_loaded = s.load[i] != NOWHERE
    if i < t.first_carrier and not is_loaded:
        return 0, t.hand_overs
    if i >= t.first_carrier and is_loaded:
        return t.docks, t.chargers
    return t.hand_overs, t.docks


@rule
def nearest_goals(s, t, i, believed):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """A robot's nearest and second nearest goal, of two as near the first; or NOWHERE."""
    first, end = goals_of(s, t, i)
    one, two, least, second = NOWHERE, NOWHERE, MANY, MANY
    for goal in range(first, end):
        if goal >= t.docks:
            is_goal = True
        elif goal >= t.hand_overs:
            is_goal = (s.lying[goal - t.hand_overs] == 0) == (i < t.first_carrier)
        else:
            is_goal = s.wanted[goal] > 0
        if is_goal:
            far = t.far[believed, goal]
            if far < least:
                two, second = one, least
                one, least = goal, far
            elif far < second:
                two, second = goal, far
    return one, two


@rule
def nearest_two(s, t, goal):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The two least ways that robots on the floor have to a goal of theirs."""
    if goal >= t.docks:
        is_picker, is_loaded = False, True
    elif goal >= t.hand_overs:
        is_picker = s.lying[goal - t.hand_overs] == 0
        is_loaded = is_picker
    else:
        is_picker, is_loaded = True, False
    one, two = FAR, FAR
    for i in range(
        0 if is_picker else t.first_carrier, t.first_carrier if is_picker else len(s.cell)
    ):
        if (s.load[i] != NOWHERE) == is_loaded and is_there(s, i):
            far = t.far[s.cell[i], goal]
            if far < one:
                one, two = far, one
            elif far < two:
                two = far
    return one, two


@rule
def nearest_charger(s, t, cell, believed):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The nearest charger without another robot, or the nearest one where all have one."""
    free, any_, least, least_any = NOWHERE, NOWHERE, MANY, MANY
    has_free = False
    for place in range(t.chargers, len(t.places)):
        there = t.places[place]
        far = t.far[believed, place]
        if far < least_any:
            any_, least_any = place, far
        if there != cell and s.robot_at[there] != 0:
            far = FAR  # not left out: a robot that believes to be in a wall is FAR from all
        else:
            has_free = True
        if far < least:
            free, least = place, far
    return free if has_free else any_


# -- places in an observation


@rule
def tell(t, seen, k, place, believed):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Writes the k-th place, but for rivals."""
    at = OWN + k * PLACE
    width, cell = t.width, t.places[place]
    far = t.far[believed, place]
    seen[at] = 1
    seen[at + 1] = cell % width - believed % width
    seen[at + 2] = cell // width - believed // width
    seen[at + 3] = min(far, len(t.kinds))
    for move in range(4):
        ahead = t.ways[believed, move]
        if ahead != NOWHERE and t.far[ahead, place] < far:
            seen[at + 5 + move] = 1


@rule
def tell_rival(s, t, i, seen, k, goal, one, two):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Writes how near the nearest other robot is, of the two least ways to its k-th goal."""
    seen[OWN + k * PLACE + 4] = min(two if t.far[s.cell[i], goal] == one else one, len(t.kinds))


# -- masks, infos, the state


@rule
def mask(s, t, masks):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shows the actions that all robots may take."""
    for i in range(len(s.cell)):
        mask_one(s, t, i, masks[i])


@rule
def mask_one(s, t, i, legal):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shows the actions that a robot may take (R4)."""
    cell = s.cell[i]
    for action in range(ACTIONS):
        legal[action] = 0
    legal[NOOP] = 1
    if s.battery[i] > 0 and cell != NOWHERE:
        for move in range(4):
            legal[move] = 1 if t.ways[cell, move] != NOWHERE else 0
        legal[HANDLE] = 1 if can_handle(s, t, i) else 0


@rule
def inform(s, t, infos):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Tells the true places of all robots, and the number of undelivered orders."""
    for i in range(len(s.cell)):
        inform_one(s, t, i, infos[i])


@rule
def inform_one(s, t, i, info):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Tells the same to one robot."""
    info.position[0], info.position[1] = s.cell[i] % t.width, s.cell[i] // t.width
    info.undelivered = len(s.arrival) - s.delivered


@rule
def overview(s, t, state):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shows the whole state."""
    state[0] = min(s.clock, MANY)
    state[1] = len(s.arrival) - s.arrived
    state[2] = s.delivered
    at = HEADER
    for i in range(len(s.cell)):
        if is_there(s, i):
            state[at] = 1
            state[at + 1], state[at + 2] = s.cell[i] % t.width, s.cell[i] // t.width
            state[at + 3] = 0 if s.load[i] == NOWHERE else 1
            state[at + 4] = s.battery[i]
        else:
            for k in range(PER_ROBOT):
                state[at + k] = 0
        at += PER_ROBOT
    cells = len(t.kinds)
    for cell in range(cells):
        state[at + cell] = t.kinds[cell]
        state[at + cells + cell] = 0
    for shelf in range(len(s.wanted)):
        state[at + cells + t.places[shelf]] = s.wanted[shelf]
    for place in range(len(s.lying)):
        state[at + cells + t.places[t.hand_overs + place]] = 0 if s.lying[place] == 0 else 1
