"""Pursuers hunt evaders on a field of cells; who is caught or starves dies and leaves.

    R1. The field has `rows` by `columns` cells. Each cell in an odd row and an odd column, counted
        from 0, is a rock with probability `rocks`, drawn anew for each episode; so no free cell is
        ever cut off from another.
    R2. Pursuers, then evaders are put into free cells, each of them drawn. A cell holds one.
    R3. Each tick all move at once: 0 nowhere, 1 to 4 a cell to the north, east, south, west. Nobody
        goes off the field, into a rock, or into a cell in which somebody stood as the tick began.
    R4. Into a cell that several want nobody goes.
    R5. An evader is caught where, after the moves, `catchers` pursuers or more are beside it (in
        the four cells next to it), or as many as it has sides that are neither rock nor edge. It is
        paid BEING_CAUGHT ("capture"), terminated ("caught"), and leaves the field.
    R6. Pursuers beside an evader that is caught share CATCH ("prey") equally. A pursuer may have a
        share in several: all catches of a tick are looked for at once, before anybody leaves.
    R7. A pursuer begins with `stamina` units of energy and spends one a tick; who has a share in a
        catch has `stamina` again. At 0 it is paid STARVING ("hunger"), terminated ("starved"), and
        leaves the field. With `stamina` 0 nobody starves.
    R8. An evader that isn't caught is paid TICK each tick ("survival").
    R9. Without any evader left the pursuers are terminated ("cleared"), without any pursuer the
        evaders ("free"). After `horizon` ticks all are truncated ("horizon").
    R10. Everybody sees the cells up to `pursuer_sight` or `evader_sight` rows and columns away, in
        three planes: what is closed (rock, or off the field), pursuers, evaders. Pursuers are seen
        by pursuers with their energy in percent, rounded up, by evaders as 1. Who has just died
        sees the field without itself.
    R11. Evaders are agents, or (argument `evaders_are`) follow a script: `flee` goes where the
        nearest pursuer in sight will be furthest, by chance where that is equal, and wanders where
        there is none; `wander` moves by chance; `still` stays.

An episode is solved where no evader is left. Nothing is looked up for pairs of agents: a tick costs
the same for each, for ten and for thousands (see `benchmarks/pursuit.py`).

Source: a task of our own. That caught agents leave, and the plane for each kind, are as in the
pursuit of Gupta, Egorov & Kochenderfer 2017 ("Cooperative multi-agent control using deep
reinforcement learning"), in which catches and collisions are others.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from gamekeeper.envs import pursuit_rules as rules
from gamekeeper.envs.drawing import BLUE, CELL, INK, ORANGE, Canvas, text_of
from gamekeeper.envs.pursuit_policies import greedy, lazy, reference
from gamekeeper.errors import SpecError
from gamekeeper.kernels.faces import KernelTicks
from gamekeeper.kernels.kernel import Kernel

SCRIPTS: Final = ("agents", "flee", "wander", "still")
"""Who moves the evaders; the numbers are those of the rules."""
MOST_ENERGY: Final = 32_000
LONGEST: Final = 960
"""Pixels along a picture's longer side, about."""
METADATA: Final = {
    "name": "pursuit_v0",
    "render_modes": ["ansi", "rgb_array"],
    "render_fps": 8,
    "is_parallelizable": True,
}
TABLES: Final = np.dtype(
    [
        ("rows", "i8"), ("columns", "i8"), ("border", "i8"), ("width", "i8"), ("pursuers", "i8"),
        ("evaders", "i8"), ("pursuer_sight", "i8"), ("evader_sight", "i8"), ("catchers", "i8"),
        ("stamina", "i8"), ("script", "i8"), ("rocks", "f8"), ("ahead", "i8", (rules.MOVES,)),
    ]
)  # fmt: skip
"""The task's numbers; `ahead`: what a move adds to the number of a cell."""


def pursuit_kernel(
    *,
    pursuers: int = 8,
    evaders: int = 8,
    rows: int = 16,
    columns: int = 16,
    catchers: int = 2,
    stamina: int = 150,
    rocks: float = 0.3,
    pursuer_sight: int = 4,
    evader_sight: int = 3,
    evaders_are: str = "agents",
    horizon: int = 500,
) -> Kernel:
    """The rules as a kernel; arguments as of `Pursuit`.

    Raises:
        SpecError: a number is out of its range, or the field is too small for so many.
    """
    given = locals()
    _check_all(given)
    count = pursuers + evaders
    border = max(pursuer_sight, evader_sight)
    width = columns + 2 * border
    given |= {"border": border, "width": width, "script": SCRIPTS.index(evaders_are)}
    given["ahead"] = (0, -width, 1, width, -1)
    tables = np.zeros(1, TABLES)
    for name in TABLES.names or ():
        tables[name] = given[name]
    both = evaders_are == "agents"
    seen = dict.fromkeys(_names("pursuer", pursuers), _window(pursuer_sight, rules.FULL))
    if both:
        seen |= dict.fromkeys(_names("evader", evaders), _window(evader_sight, 1))
    return Kernel(
        name="pursuit_v0",
        agents=tuple(seen),
        observation_space=seen,
        action_space=Discrete(rules.MOVES),
        state=[
            ("grid", "i4", ((rows + 2 * border) * width,)), ("nearest", "i4", (rules.MOVES,)),
            ("cells", "i4", (count,)), ("aims", "i4", (count,)), ("gone", "i4", (count,)),
            ("there", "i1", (count,)), ("beside", "i1", (count,)), ("energy", "i4", (pursuers,)),
            ("pursuers", "i4"), ("evaders", "i4"),
        ],
        reset=rules.reset,
        step=rules.step_of_both if both else rules.step_of_pursuers,
        observe=rules.observe_both if both else rules.observe_pursuers,
        inform=rules.inform,
        info=[("position", "i8", (2,)), ("energy", "i8"), ("evaders", "i8")],
        overview=rules.overview,
        state_space=Box(-2, max(stamina, 1), (rows, columns), np.int16),
        tables=tables,
        terms=("prey", "hunger", "capture", "survival"),
        endings=("caught", "starved", "cleared", "free"),
        horizon=horizon,
        metadata=METADATA,
    )  # fmt: skip


def _check_all(given: Mapping[str, Any]) -> None:
    """Refuses numbers out of their ranges, and a field that is too small."""
    least = {"pursuers": 1, "evaders": 1, "rows": 2, "columns": 2, "catchers": 1, "stamina": 0}
    for name in (*least, "pursuer_sight", "evader_sight", "horizon"):
        _check(name, given[name], least.get(name, 1), {"catchers": 4, "stamina": MOST_ENERGY})
    rocks, evaders_are = given["rocks"], given["evaders_are"]
    if not 0.0 <= rocks <= 1.0:
        raise SpecError(
            "rocks is a probability", where="rocks", expected="0 to 1", seen=repr(rocks)
        )
    if evaders_are not in SCRIPTS:
        raise SpecError(
            "nobody knows how to move the evaders", where="evaders_are",
            expected=" | ".join(SCRIPTS), seen=repr(evaders_are),
        )  # fmt: skip
    rows, columns = given["rows"], given["columns"]
    free = rows * columns - (rows // 2) * (columns // 2)
    count = given["pursuers"] + given["evaders"]
    if 2 * count > free:
        raise SpecError(
            "the field is too small for so many",
            where="rows, columns",
            expected=f"{2 * count} cells that can't be rocks, two for each of them",
            seen=str(free),
            mend="make the field larger, or play with fewer",
        )


def _names(role: str, count: int) -> tuple[str, ...]:
    return tuple(f"{role}_{i}" for i in range(count))


def _window(sight: int, most: int) -> Box:
    """Planes of what is closed, of pursuers and of evaders, [side, side, 3] int8 (R10)."""
    side = 2 * sight + 1
    high = np.ones((side, side, 3), np.int8)
    high[..., 1] = most
    return Box(np.zeros_like(high), high, dtype=np.int8)


def _check(name: str, value: int, least: int, most: dict[str, int]) -> None:
    if type(value) is not int or value < least or value > most.get(name, value):
        ends = f" and at most {most[name]}" if name in most else ""
        raise SpecError(
            "pursuit can't be played with that",
            where=name,
            expected=f"a whole number of at least {least}{ends}",
            seen=repr(value),
        )


class Pursuit(KernelTicks):
    """Pursuers and evaders, [side, side, 3] int8 windows each; see R1 to R11.

    Infos tell `position` (row, column), `energy` (0 of evaders) and `evaders`, how many are left.

    Args:
        pursuers, evaders: how many there are, to thousands.
        rows, columns: of the field; it has two cells or more for each agent.
        catchers: how many pursuers it takes to catch an evader, 1 to 4.
        stamina: ticks that a pursuer lives on a catch; 0: for ever.
        rocks: probability that a cell which may be a rock is one.
        pursuer_sight, evader_sight: rows and columns that one sees to each side.
        evaders_are: `agents`, or the script that they follow: `flee`, `wander`, `still`.
        horizon: ticks after which all are truncated.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints in them.
    Raises:
        SpecError: a number is out of its range, or the field is too small for so many.
    """

    metadata = METADATA
    contract = "pursuit.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so
    not_batched = ""

    def __init__(
        self, *, render_mode: str | None = None, debug: bool = False, **numbers: Any
    ) -> None:
        super().__init__(pursuit_kernel(**numbers), render_mode=render_mode, debug=debug)

    def render(self) -> str | NDArray[np.uint8] | None:
        """The field: `#` rock, `P` pursuer, `e` evader; or cells of at most 24 pixels."""
        if self.render_mode not in ("ansi", "rgb_array"):
            return None
        field = self.state()
        if self.render_mode == "ansi":
            letters = np.array(list("#e.P"))[np.minimum(field, 1) + 2]
            return text_of(letters.tolist(), f"{int((field == -1).sum())} evaders left")
        rows, columns = field.shape
        canvas = Canvas(columns, rows, cell=min(CELL, max(LONGEST // max(rows, columns), 2)))
        for row, column in np.argwhere(field).tolist():
            if field[row, column] == -2:
                canvas.fill(column, row, INK)
            else:
                canvas.disc(column, row, BLUE if field[row, column] > 0 else ORANGE)
        return canvas.pixels
