"""Warehouse robots: what they can do, and who may move where all move at once (R9).

That answer is one, whatever order the robots are asked in.
"""

from __future__ import annotations

from typing import Final

from gamekeeper.envs.layouts import NOWHERE
from gamekeeper.envs.warehouse_floor import REACH, ROOM
from gamekeeper.kernels.rules import rule

NORTH, EAST, SOUTH, WEST, NOOP, HANDLE = range(6)
ACTIONS: Final = 6
PICKER, CARRIER = 1, 2
"""Marks of robots on the floor."""
TIE: Final = -1
"""What stands in `s.claims` of a cell that several want; else 1 + the number of who wants it."""


@rule
def refuse(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Finds in `s.refused` whose move is refused: the least set that leaves a robot a cell at most.

    `s.wants` holds the cell that each robot wants, NOWHERE for who stays. Refused are all who want
    one cell (a tie), who want the cell of one that doesn't move, and both of two that want each
    other's cells (a swap). Who is refused doesn't move, so refused are also those who want its
    cell, and so on down the queue. Everybody else moves: queues of which the first moves on, and
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
    """Robot i isn't in its cell any more."""
    s.robot_at[s.cell[i]] = 0
    s.marks[padded(t, s.cell[i])] = 0


@rule
def enter(s, t, i, cell):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Robot i is in a cell."""
    s.cell[i] = cell
    s.robot_at[cell] = i + 1
    s.marks[padded(t, cell)] = PICKER if i < t.first_carrier else CARRIER


@rule
def is_there(s, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Whether robot i is on the floor."""
    return s.cell[i] >= 0 and s.robot_at[s.cell[i]] == i + 1


@rule
def padded(t, cell):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The place of a cell on the floor with REACH cells more on each side."""
    return (cell // t.width + REACH) * (t.width + ROOM) + cell % t.width + REACH
