"""The physics of the Multi-Agent Particle Environments, as rules over one copy's state.

Bodies are discs in the plane. Agents move, marks (landmarks) don't. Rules that `spread`, `tag`,
`reference` and `speaker_listener` share:

    P1. A tick moves an agent by its velocity times DT; of the velocity 1 - DAMPING stays, and force
        times DT is added (all masses are 1); what is above its top speed is cut to it.
    P2. Of its five moves (nothing, left, right, down, up) each but the first is a force of the
        agent's strength. A continuous action says how much of each: right minus left, up minus
        down.
    P3. Bodies that collide push each other apart with CONTACT_FORCE times how deep they stand in
        each other, softened: log(1 + exp(-gap / MARGIN)) * MARGIN, where their edges are
        nearer than CLOSE. Marks push and aren't pushed.
    P4. A word is heard as it was said: one of several flags, or, of continuous actions, a
        number for each.

Float operations stand in the order in which mpe2 has them, so that results are equal to the last
digit where the C library's `exp` and `log1p` are NumPy's; but mpe2 computes pushes at any distance,
so what is 0 here may be a number below 1e-17 there. Bodies at the very same point don't push each
other (mpe2: NaN); of equally near bodies the lowest number is taken first.

Source: mpe2 1.1.1, `_mpe_utils/core.py` and `simple_env.py`; Lowe et al. 2017, "Multi-Agent
Actor-Critic for Mixed Cooperative-Competitive Environments"; Mordatch & Abbeel 2017.
"""

import math
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete, Space

from gamekeeper.kernels import draws
from gamekeeper.kernels.kernel import Field
from gamekeeper.kernels.scalar_rules import inlined, rule
from gamekeeper.tasks.arguments import check_whole

DT: Final = 0.1
"""A tick in seconds."""
DAMPING: Final = 0.25
KEPT: Final = 1 - DAMPING
CONTACT_FORCE: Final = 1e2
MARGIN: Final = 1e-3
"""Width of the softening of contacts."""
STRENGTH: Final = 5.0
"""Force of a move, of agents that have none of their own."""
NOTHING, LEFT, RIGHT, DOWN, UP = range(5)
MOVES: Final = 5
CLOSE: Final = 0.038
"""Bodies that are farther apart don't push: it would be with less than 4e-18."""
HORIZON: Final = 25
"""Ticks of an episode, as the contracts have them."""
MOST: Final = 10_000
"""The most bodies of a kind, or ticks, that a task may have."""
MARK_SIZE: Final = 0.05
"""Radius of a mark that has none of its own."""


def bodies(agents: int, marks: int) -> list[Field]:
    """Returns the fields of so many bodies: places, velocities, the forces of the last tick."""
    moving: list[Field] = [(name, "f8", (agents,)) for name in ("x", "y", "vx", "vy", "fx", "fy")]
    return [*moving, ("mark_x", "f8", (marks,)), ("mark_y", "f8", (marks,))]


def seen_space(length: int) -> Box:
    """Returns the space of observations of that length, as mpe2 has it."""
    return Box(-np.inf, np.inf, (length,), np.float32)


def action_space(*, continuous: bool, words: int = 0) -> Space[Any]:
    """Returns the actions of an agent that moves, and may say one of so many words."""
    if continuous:
        return Box(0.0, 1.0, (MOVES + words,), np.float32)
    return Discrete(MOVES * max(words, 1))


def check_counts(**counts: int | None) -> None:
    """Refuses an argument that is neither None nor a number of things, from 1 to MOST.

    Raises:
        SpecError: names it.
    """
    for name, count in counts.items():
        if count is not None:
            check_whole(name, count, 1, MOST)


def least_square(distance: float) -> float:
    """The least number whose square root isn't below the distance, to the last digit."""
    square = distance * distance
    while math.sqrt(square) >= distance:
        square = math.nextafter(square, 0.0)
    while math.sqrt(square) < distance:
        square = math.nextafter(square, math.inf)
    return square


@rule
def scatter(s, reach):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Draws where agents are, and marks within `reach` of both axes."""
    for i in range(len(s.x)):
        s.x[i] = draws.uniform(s, -1.0, 1.0)
        s.y[i] = draws.uniform(s, -1.0, 1.0)
    for k in range(len(s.mark_x)):
        s.mark_x[k] = draws.uniform(s, -reach, reach)
        s.mark_y[k] = draws.uniform(s, -reach, reach)


@inlined
def steer(s, i, move, strength):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Sets the force of one of the moves (P2)."""
    s.fx[i] = strength * ((move == RIGHT) - (move == LEFT))
    s.fy[i] = strength * ((move == UP) - (move == DOWN))


@inlined
def steer_as(s, i, moves, place, strength):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Sets the force of the move `moves[place]` (P2)."""
    steer(s, i, moves[place], strength)


@inlined
def steer_by(s, i, amounts, place, strength):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Sets the force of the continuous action `amounts[place]` (P2)."""
    right = np.float32(amounts[place, RIGHT] - amounts[place, LEFT])  # as narrow as actions are
    up = np.float32(amounts[place, UP] - amounts[place, DOWN])
    s.fx[i] = strength * float(right)
    s.fy[i] = strength * float(up)


@inlined
def penetration(gap):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Depth of bodies in each other whose edges are `gap` apart, less than CLOSE (P3)."""
    z = -gap / MARGIN
    if z > 0.0:
        return (z + math.log1p(math.exp(-z))) * MARGIN
    return math.log1p(math.exp(z)) * MARGIN


@inlined
def repulsion(dx, dy, reach):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Force on a body from another one, dx, dy away (P3).

    Args:
        dx, dy: the way from the other to it.
        reach: the sum of their radii.
    """
    square = dx * dx + dy * dy
    if square > (reach + CLOSE) * (reach + CLOSE) or square == 0.0:
        return 0.0, 0.0
    distance = math.sqrt(square)
    depth = penetration(distance - reach)
    return CONTACT_FORCE * dx / distance * depth, CONTACT_FORCE * dy / distance * depth


@inlined
def push_agents(s, i, j, reach):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Lets two agents push each other."""
    fx, fy = repulsion(s.x[i] - s.x[j], s.y[i] - s.y[j], reach)
    s.fx[i] += fx
    s.fy[i] += fy
    s.fx[j] -= fx
    s.fy[j] -= fy


@inlined
def push_off(s, i, k, reach):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Lets a mark push an agent."""
    fx, fy = repulsion(s.x[i] - s.mark_x[k], s.y[i] - s.mark_y[k], reach)
    s.fx[i] += fx
    s.fy[i] += fy


@inlined
def drift(s, i):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Moves an agent, and changes its velocity by its force (P1)."""
    s.x[i] += s.vx[i] * DT
    s.y[i] += s.vy[i] * DT
    s.vx[i] = s.vx[i] * KEPT + s.fx[i] * DT
    s.vy[i] = s.vy[i] * KEPT + s.fy[i] * DT


@inlined
def slow_down(s, i, top):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Cuts an agent's speed to its top speed (P1)."""
    speed = math.sqrt(s.vx[i] * s.vx[i] + s.vy[i] * s.vy[i])
    if speed > top:
        s.vx[i] = s.vx[i] / speed * top
        s.vy[i] = s.vy[i] / speed * top


@inlined
def apart(s, i, j):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Distance of two agents."""
    dx = s.x[i] - s.x[j]
    dy = s.y[i] - s.y[j]
    return math.sqrt(dx * dx + dy * dy)


@inlined
def away(s, i, k):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Distance of an agent from a mark."""
    dx = s.x[i] - s.mark_x[k]
    dy = s.y[i] - s.mark_y[k]
    return math.sqrt(dx * dx + dy * dy)
