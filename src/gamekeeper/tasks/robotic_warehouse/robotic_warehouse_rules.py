"""The rules of `robotic_warehouse`, R1 to R11 of its docstring, over one copy's state."""

from typing import Final

from gamekeeper.kernels import draws
from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.tasks.arguments import NEVER
from gamekeeper.tasks.robotic_warehouse.robotic_warehouse_floor import (
    BEYOND,
    HIGHWAY,
    OWN,
    PLACE,
    SENSED,
)

NOOP, FORWARD, LEFT, RIGHT, TOGGLE = range(5)
INDIVIDUAL, GLOBAL, TWO_STAGE = range(3)
INACTIVITY: Final = 1
"""Number of this ending, from 1."""


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Shelves in their places, robots and requests anywhere (R1)."""
    for k in range(len(t.homes)):
        s.codes[t.homes[k]] = 5
    for i in range(len(s.cell)):
        cell = t.cells[draws.integers(s, len(t.cells))]
        while s.robots[cell] != 0:
            cell = t.cells[draws.integers(s, len(t.cells))]
        s.robots[cell] = i + 1
        s.cell[i] = cell
        s.to[i] = cell
    for i in range(len(s.cell)):
        s.facing[i] = draws.integers(s, 4)
        s.codes[s.cell[i]] += 1 + s.facing[i]
    for _ in range(t.requests):
        cell = t.homes[draws.integers(s, len(t.homes))]
        while s.codes[cell] >= 10:
            cell = t.homes[draws.integers(s, len(t.homes))]
        s.codes[cell] += 5


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
            s.codes[s.cell[i]] += facing - s.facing[i]
            s.facing[i] = facing
    s.idle += 1
    for g in range(len(t.goals)):
        if s.codes[t.goals[g]] >= 10:
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
                stands = s.codes[cell] >= 5 and not (other >= 0 and s.load[other] != 0)
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
    """Tells whether all ahead of robot i go, up to a free cell or round a ring (R5)."""
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
            seen = 1 + s.facing[i] if s.load[i] == 0 else s.codes[s.cell[i]]
            s.behind[i] = seen
            s.codes[s.cell[i]] -= seen
            s.robots[s.cell[i]] = 0
    for i in range(len(s.cell)):
        if s.behind[i] > 0:
            s.cell[i] = s.to[i]
            s.codes[s.cell[i]] += s.behind[i]
            s.robots[s.cell[i]] = i + 1
            s.behind[i] = 0


@rule
def toggle(s, t, i, rewards):  # type: ignore[no-untyped-def]  # likewise
    """Robot i takes the shelf over it, or puts down its own (R3, R8)."""
    if s.load[i] == 0:
        if s.codes[s.cell[i]] >= 5:
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
    for c in range(len(s.codes)):
        if 5 <= s.codes[c] < 10:
            if left == 0:
                s.codes[c] += 5
                break
            left -= 1
    s.codes[goal] -= 5
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
    """Observation of the robots: themselves, and what they sense around them (R9)."""
    for i in range(len(s.cell)):
        cell = s.cell[i]
        at = OWN + SENSED * len(t.around)
        for k in range(len(t.around) - 1, -1, -1):
            at -= SENSED
            sense(t, s.codes[cell + t.around[k]], obs, i, at - 1)
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
    a, b, c, d = t.sensed[code, 0], t.sensed[code, 1], t.sensed[code, 2], t.sensed[code, 3]
    e, f, g, h = t.sensed[code, 4], t.sensed[code, 5], t.sensed[code, 6], t.sensed[code, 7]
    obs[i, at], obs[i, at + 1], obs[i, at + 2], obs[i, at + 3] = a, b, c, d
    obs[i, at + 4], obs[i, at + 5], obs[i, at + 6], obs[i, at + 7] = e, f, g, h


@rule
def inform(s, t, infos):  # type: ignore[no-untyped-def]  # likewise
    """Number of delivered shelves, and the way (right, down) to the nearest of each kind.

    0, 0 where there is none: of requested shelves that nobody carries, of goals, of empty places;
    and of the highway beside that place.
    """
    for i in range(len(s.cell)):
        infos[i].delivered = s.delivered
        best, far = -1, NEVER
        for k in range(len(t.cells)):
            c = t.cells[k]
            is_carried = s.robots[c] > 0 and s.load[s.robots[c] - 1] != 0
            if s.codes[c] >= 10 and not is_carried and steps_to(s, t, i, c) < far:
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
            if s.codes[c] < 5 and steps_to(s, t, i, c) < far:
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
        state[3, y, x] = s.codes[cell] // 5
