"""Warehouse robots: what they are, what they can do, and who may move where all move at once.

That answer is one, whatever order the robots are asked in.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Final, TypeVar

from gamekeeper.tasks.warehouse.warehouse_floor import NOWHERE

Agent = TypeVar("Agent", bound=Hashable)

NORTH, EAST, SOUTH, WEST, NOOP, HANDLE = range(6)
ACTIONS: Final = 6


@dataclass(slots=True)
class Robot:
    """What a robot is and has.

    Args:
        role: `picker` or `carrier`.
        cell: where it is, or was when it ended; NOWHERE for a spare.
        battery: units left.
        load: the shelf whose item it has, or NOWHERE.
    """

    role: str
    cell: int
    battery: int
    load: int = NOWHERE


def refused_moves(
    moves: Mapping[Agent, tuple[int, int]], stands: Mapping[int, Agent]
) -> set[Agent]:
    """The robots whose move is refused: the least set that leaves a robot a cell at most.

    Refused are all who want one cell (a tie), who want the cell of one that doesn't move, and both
    of two that want each other's cells (a swap). Who is refused doesn't move, so refused are also
    those who want its cell, and so on down the queue. Everybody else moves: queues of which the
    first moves on, and rings of three or more that turn (a rotation).

    Args:
        moves: by robot that moves, the cell it is in and the other one that it wants.
        stands: by cell, the robot in it; those that move are among them.
    """
    followers: dict[int, list[Agent]] = {}
    for agent, (_, wanted) in moves.items():
        followers.setdefault(wanted, []).append(agent)
    refused: set[Agent] = set()
    for cell, agents in followers.items():
        there = stands.get(cell)
        is_tie = len(agents) > 1
        is_taken = there is not None and (
            there not in moves or moves[there][1] == moves[agents[0]][0]
        )
        if is_tie or is_taken:
            refused.update(agents)
    undone = list(refused)
    while undone:
        for agent in followers.get(moves[undone.pop()][0], ()):
            if agent not in refused:
                refused.add(agent)
                undone.append(agent)
    return refused
