"""Actions of warehouse robots: the rules of both warehouses, over one copy's state.

`step` resolves the actions of all at once, `act` the action of one; R1 to R14 and T1 to T3 stand in
the modules of the tasks.
"""

from typing import Final

from gamekeeper.kernels import draws
from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.tasks.warehouse.warehouse_floor import (
    CHARGES,
    DOCKS,
    HANDS_OVER,
    NOWHERE,
    REACH,
    ROOM,
)

NORTH, EAST, SOUTH, WEST, NOOP, HANDLE = range(6)
ACTIONS: Final = 6
PICKER, CARRIER = 1, 2
"""Marks of robots on the floor."""
TIE: Final = -1
"""Value of `s.claims` for a cell that several robots want; else 1 + the number of the one."""


@rule
def refuse(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Finds refused moves, in `s.refused`: the least set that leaves at most one robot in a cell.

    `s.wants` holds the cell that each robot wants, NOWHERE for one that stays. Refused are robots
    that want one cell (a tie) or the cell of one that doesn't move, and both of two that want each
    other's cells (a swap). A refused robot doesn't move, so that those that want its cell are
    refused too, and so on down the queue. All others move: queues of which the first moves on, and
    rings of three or more that turn (a rotation).
    """
    for i in range(len(s.wants)):
        cell = s.wants[i]
        s.refused[i] = 0
        if cell != NOWHERE:
            s.claims[cell] = i + 1 if s.claims[cell] == 0 else TIE
    for i in range(len(s.wants)):
        cell = s.wants[i]
        if cell != NOWHERE:
            is_refused = s.claims[cell] == TIE
            if s.robot_at[cell] != 0:
                its = s.wants[s.robot_at[cell] - 1]
                is_refused |= its == NOWHERE or its == s.cell[i]
            s.refused[i] = 1 if is_refused else 0
    for i in range(len(s.wants)):
        if s.wants[i] != NOWHERE and s.refused[i] != 0:
            behind = s.claims[s.cell[i]] - 1
            while behind >= 0 and s.refused[behind] == 0:  # of a tie all are refused already
                s.refused[behind] = 1
                behind = s.claims[s.cell[behind]] - 1
    for i in range(len(s.wants)):
        if s.wants[i] != NOWHERE:
            s.claims[s.wants[i]] = 0


@rule
def leave(s, t, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Takes robot i out of its cell."""
    s.robot_at[s.cell[i]] = 0
    s.marks[padded(t, s.cell[i])] = 0


@rule
def enter(s, t, i, cell):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Puts robot i into a cell."""
    s.cell[i] = cell
    s.robot_at[cell] = i + 1
    s.marks[padded(t, cell)] = PICKER if i < t.first_carrier else CARRIER


@rule
def is_there(s, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """True if robot i is on the floor."""
    return s.cell[i] >= 0 and s.robot_at[s.cell[i]] == i + 1


@rule
def padded(t, cell):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Number of a cell on the floor with REACH cells more on each side."""
    return (cell // t.width + REACH) * (t.width + ROOM) + cell % t.width + REACH


DELIVERY: Final = 1.0
GRASP: Final = 0.1
COLLISION: Final = -0.25
ENERGY: Final = -0.01
"""Rewards of events."""
CHARGE: Final = 5
"""Units of battery a tick on a charger gives."""
TERMS: Final = ("grasp", "collision", "delivery", "energy")
GRASPED, COLLIDED, DELIVERED, SPENT = range(4)
ENDINGS: Final = ("battery", "cleared")
EMPTY, CLEARED = 1, 2

# -- the beginning


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Puts robots on the floor and draws orders (R2, R3)."""
    count = len(t.floors)
    cells = s.claims  # an order of the floor's cells, for as long as they are drawn
    for k in range(count):
        cells[k] = t.floors[k]
    drawn = 0
    for i in range(len(s.cell)):
        s.battery[i] = t.full
        s.load[i] = NOWHERE
        s.cell[i] = NOWHERE
        s.live[i] = 0
        if is_first(t, i):
            other = drawn + draws.integers(s, count - drawn)
            cell = cells[other]
            cells[other] = cells[drawn]
            drawn += 1
            enter(s, t, i, cell)
            s.live[i] = 1
    for k in range(count):
        cells[k] = 0
    tick = 0
    for k in range(len(s.arrival)):
        s.arrival[k] = tick
        s.asked[k] = draws.integers(s, len(s.wanted))
        tick += 1 + draws.integers(s, 2 * t.every - 1)
    take_orders(s)


@rule
def is_first(t, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """True if robot i isn't a spare."""
    if i < t.first_carrier:
        return i < t.pickers
    return i - t.first_carrier < t.carriers


@rule
def take_orders(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Opens orders that have arrived, at their shelves (R3)."""
    while s.arrived < len(s.arrival) and s.arrival[s.arrived] <= s.clock:
        s.wanted[s.asked[s.arrived]] += 1
        s.arrived += 1


# -- a step


@rule
def step(s, t, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Plays a tick: all robots act, then it ends (R4 to R14)."""
    robots = len(s.cell)
    delivered = reach_out(s, t, actions)
    for i in range(robots):
        shelf = s.wants[i]
        if shelf != NOWHERE:  # all that grasp from it, or none of them
            s.refused[i] = 1 if s.claims[t.places[shelf]] > s.wanted[shelf] else 0
    for i in range(robots):
        shelf = s.wants[i]
        if shelf != NOWHERE:
            s.claims[t.places[shelf]] = 0
            if s.refused[i] != 0:
                rewards[i, COLLIDED] += COLLISION
            else:
                grasp(s, i, shelf, rewards)
    deliver(s, delivered, rewards)
    drive(s, t, actions, rewards)
    for i in range(robots):
        if s.live[i] != 0:
            spend(s, t, i, done_by(s, i, actions[i]), rewards, truncated)
    end_tick(s, t, terminated, truncated)


@rule
def act(s, t, i, action, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Plays one robot's turn; after the last one the tick ends (T1 to T3)."""
    done = done_by(s, i, action)
    if done == HANDLE:
        shelf = shelf_to_grasp(s, t, i)
        if shelf == NOWHERE:
            deliver(s, hand_over(s, t, i), rewards)
        else:
            grasp(s, i, shelf, rewards)
    elif done < NOOP:
        cell = t.ways[s.cell[i], done]
        if cell == NOWHERE or s.robot_at[cell] != 0:
            rewards[i, COLLIDED] += COLLISION
        else:
            leave(s, t, i)
            enter(s, t, i, cell)
    spend(s, t, i, done, rewards, truncated)
    following = next_live(s, i + 1, truncated)
    if following == NOWHERE:
        end_tick(s, t, terminated, truncated)
        following = next_live(s, 0, truncated)
    s.turn = i if following == NOWHERE else following


@rule
def next_live(s, first, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The first robot from a number on that lives on, or NOWHERE."""
    for i in range(first, len(s.cell)):
        if s.live[i] != 0 and not truncated[i]:
            return i
    return NOWHERE


@rule
def done_by(s, i, action):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Action as it is carried out: none with an empty battery (R10)."""
    return action if s.battery[i] > 0 else NOOP


# -- handling


@rule
def reach_out(s, t, actions):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Plays handling but for grasps, which are noted in `wants` and `claims` (R5 to R8).

    Returns the number of delivered items.
    """
    delivered = 0
    for i in range(len(s.cell)):
        s.wants[i] = NOWHERE
        if s.live[i] != 0 and done_by(s, i, actions[i]) == HANDLE:
            shelf = shelf_to_grasp(s, t, i)
            if shelf == NOWHERE:
                delivered += hand_over(s, t, i)
            else:
                s.wants[i] = shelf
                s.claims[t.places[shelf]] += 1
    return delivered


@rule
def shelf_to_grasp(s, t, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The shelf that a robot which handles grasps from, or NOWHERE (R5)."""
    if i >= t.first_carrier or s.load[i] != NOWHERE:
        return NOWHERE
    return ordered_beside(s, t, s.cell[i])


@rule
def ordered_beside(s, t, cell):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The first shelf with an open order to the north, east, south, west, or NOWHERE."""
    for side in range(4):
        shelf = t.beside[cell, side]
        if shelf != NOWHERE and s.wanted[shelf] > 0:
            return shelf
    return NOWHERE


@rule
def can_handle(s, t, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """True if handling would have an effect (R4, R5, R7)."""
    cell = s.cell[i]
    is_hand_over = t.kinds[cell] == HANDS_OVER
    if i < t.first_carrier:
        if s.load[i] == NOWHERE:
            return ordered_beside(s, t, cell) != NOWHERE
        return is_hand_over and s.lying[t.number[cell]] == 0
    if s.load[i] == NOWHERE:
        return is_hand_over and s.lying[t.number[cell]] != 0
    return t.kinds[cell] == DOCKS


@rule
def hand_over(s, t, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Puts down, takes or delivers; returns the number of delivered items."""
    if (i < t.first_carrier and s.load[i] == NOWHERE) or not can_handle(s, t, i):
        return 0
    place = t.number[s.cell[i]]
    if i < t.first_carrier:
        s.lying[place] = s.load[i] + 1
        s.load[i] = NOWHERE
        return 0
    if s.load[i] == NOWHERE:
        s.load[i] = s.lying[place] - 1
        s.lying[place] = 0
        return 0
    s.load[i] = NOWHERE
    return 1


@rule
def grasp(s, i, shelf, rewards):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Gives a picker an item."""
    s.load[i] = shelf
    s.wanted[shelf] -= 1
    rewards[i, GRASPED] += GRASP


@rule
def deliver(s, count, rewards):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Pays all live robots for deliveries (R7)."""
    if count > 0:
        s.delivered += count
        for i in range(len(s.cell)):
            if s.live[i] != 0:
                rewards[i, DELIVERED] += count * DELIVERY


# -- moving


@rule
def drive(s, t, actions, rewards):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Moves robots (R9)."""
    robots = len(s.cell)
    for i in range(robots):
        s.wants[i] = NOWHERE
        if s.live[i] != 0:
            done = done_by(s, i, actions[i])
            if done < NOOP:
                s.wants[i] = t.ways[s.cell[i], done]
                if s.wants[i] == NOWHERE:
                    rewards[i, COLLIDED] += COLLISION
    refuse(s)
    for i in range(robots):
        if s.wants[i] != NOWHERE:
            if s.refused[i] != 0:
                rewards[i, COLLIDED] += COLLISION
            else:
                leave(s, t, i)
    for i in range(robots):
        if s.wants[i] != NOWHERE and s.refused[i] == 0:
            enter(s, t, i, s.wants[i])


# -- batteries, and the end of a tick


@rule
def spend(s, t, i, done, rewards, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Discharges or charges a battery; an empty robot leaves (R10, R11)."""
    charges = t.kinds[s.cell[i]] == CHARGES
    if done != NOOP:
        s.battery[i] -= 1
        rewards[i, SPENT] += ENERGY
    elif charges:
        s.battery[i] = min(s.battery[i] + CHARGE, t.full)
    if s.battery[i] == 0 and not charges:
        leave(s, t, i)
        if s.load[i] != NOWHERE:
            s.wanted[s.load[i]] += 1
            s.load[i] = NOWHERE
        truncated[i] = True
        s.ending[i] = EMPTY


@rule
def end_tick(s, t, terminated, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Ends a tick: the episode is over, or spares and orders come (R3, R12 to R14)."""
    s.clock += 1
    if s.delivered == len(s.arrival):
        for i in range(len(s.cell)):
            if s.live[i] != 0 and not truncated[i]:
                terminated[i] = True
                s.ending[i] = CLEARED
    elif s.clock != t.last_tick:  # with it all are truncated, and no spare joins
        let_join(s, t, 0, t.first_carrier, t.pickers)
        let_join(s, t, t.first_carrier, len(s.cell), t.carriers)
    take_orders(s)


@rule
def let_join(s, t, first, end, most):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Lets spares of a role take the places of robots that ended (R12)."""
    there = 0
    for i in range(first, end):
        there += 1 if is_there(s, i) else 0
    charger = t.chargers
    for i in range(first, end):
        if s.cell[i] == NOWHERE and there < most:
            while charger < len(t.places) and s.robot_at[t.places[charger]] != 0:
                charger += 1
            if charger == len(t.places):
                return
            enter(s, t, i, t.places[charger])
            s.live[i] = 1
            there += 1
