"""Pickers and carriers clear the orders of a warehouse together; all robots move once a tick.

Floor and roster
    R1. The floor is a grid of open cells, shelves and walls; among the open cells are hand-over
        cells, docks and chargers. An open cell holds one robot at most.
    R2. Robots begin with full batteries on random floor cells. Spares wait at the chargers' doors,
        outside the floor.
    R3. The first order is there at the start; each further one arrives 1 to 2 `every` - 1 ticks
        after the one before (`every` on average), for a random shelf, until there were `orders`.
        When and where is drawn as the episode begins, so nothing a robot does changes it.
Actions, resolved together
    R4. Actions 0 to 3 move a robot north, east, south, west; 4 does nothing; 5 handles. A move off
        the open cells and a handling that would come to nothing are masked out; tried all the
        same, they change nothing but what R9 and R10 take for it.
    R5. A picker handles: without an item, beside a shelf with an open order, it grasps the item
        (the first such shelf of north, east, south, west) and is paid `grasp`; with an item, on a
        hand-over cell where none lies, it puts it down.
    R6. Where more pickers grasp from a shelf than it has open orders, none of them gets an item
        and each pays `collision`.
    R7. A carrier handles: without an item, on a hand-over cell where one lies, it takes it; with an
        item, on a dock, it delivers it, and every live robot is paid `delivery`.
    R8. Handling looks at the cells as the tick began; robots that handle don't move.
    R9. Moves are resolved together, whatever the order of the actions. Refused are robots that want
        one cell or the cell of a robot that stays or is refused, both of two that would swap, and
        one that would leave the open cells. A queue moves on behind one
        that moves, and a ring of three or more turns. A refused robot stays and pays
        `collision`; one that was run into pays nothing.
Batteries
    R10. A tick in which a robot moves, tries to, or handles costs one unit of its battery, and it
        pays `energy`; a tick in which it does nothing on a charger gives CHARGE units. With an
        empty battery everything but doing nothing is masked out, and comes to nothing.
    R11. A robot whose battery is empty, and that is on no charger, is truncated alone ("battery")
        and taken off the floor; the order of the item it had is open again at its shelf.
    R12. After each tick, for each role, where fewer robots are live than the episode began with,
        the next spare joins on the first charger without a robot, if there is one.
Ends
    R13. When all orders are delivered, after the tick, all are terminated ("cleared").
    R14. After `horizon` ticks (the contract's, 200, unless given) all are truncated ("horizon").

An episode is solved where it ends "cleared". The shape of the task, robots that contend for cells
on a grid and deliver requested items, is that of RWARE (Papoudakis et al. 2021, "Benchmarking
Multi-Agent Deep Reinforcement Learning Algorithms in Cooperative Tasks"); rules, roles, batteries
and rewards are our own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Final, Unpack

import numpy as np
from gymnasium.spaces import Discrete
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import MaskedTicks
from gamekeeper.kernels.scalar_rules import Copy, Plain, as_python
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks import drawing
from gamekeeper.tasks.disturbances import Disturbed, DisturbedTicks
from gamekeeper.tasks.drawing import Canvas, Color, metadata_of
from gamekeeper.tasks.knobs import KnobArguments, Knobs
from gamekeeper.tasks.warehouse import warehouse_rules as work
from gamekeeper.tasks.warehouse import warehouse_sight as sight
from gamekeeper.tasks.warehouse.warehouse_floor import (
    NOWHERE,
    FloorLayout,
    Sizes,
    sizes_of,
    state_of,
    tables_of,
)
from gamekeeper.tasks.warehouse.warehouse_rules import ACTIONS, HANDLE, NOOP
from gamekeeper.tasks.warehouse.warehouse_sight import KINDS_AT, OWN, PLACE, ROBOTS_AT, SIDE

SIGNS: Final = {".": ".", "#": "#", "s": "%", "h": "_", "d": "=", "c": "+"}
COLORS: Final[dict[str, Color]] = {
    "#": drawing.INK,
    "s": drawing.WOOD,
    "h": (206, 212, 218),
    "d": drawing.GREEN,
    "c": drawing.YELLOW,
}
ROBOTS: Final[dict[str, Color]] = {"picker": drawing.BLUE, "carrier": drawing.ORANGE}


def text(task: WarehouseRules) -> str:
    """Returns the floor in letters.

    `p c` robots (capital with an item), `%` shelf (or its open orders), `_` hand-over cell (`*`
    with an item), `=` dock, `+` charger, `#` wall.
    """
    floor = task.floor
    letters = [SIGNS[letter] for letter in floor.text]
    for cell, count in zip(floor.shelves, task.wanted, strict=True):
        if count:
            letters[cell] = str(min(count, 9))
    for cell in task.lying:
        letters[cell] = "*"
    for cell, agent in task.stands.items():
        robot = task.robots[agent]
        letters[cell] = robot.role[0] if robot.load == NOWHERE else robot.role[0].upper()
    rows = (letters[at : at + floor.width] for at in range(0, floor.size, floor.width))
    weak = [a for a in task.stands.values() if 4 * task.robots[a].battery <= task.battery]
    return drawing.text_of(
        rows,
        f"tick {task.ticks}, delivered {task.delivered} of {task.orders}",
        f"low battery: {', '.join(weak)}" if weak else "",
    )


def picture(task: WarehouseRules) -> NDArray[np.uint8]:
    """Returns the floor in pixels: robots are discs with their batteries, items are red."""
    floor = task.floor
    canvas = Canvas(floor.width, floor.height)
    for cell, letter in enumerate(floor.text):
        if letter in COLORS:
            canvas.fill(cell % floor.width, cell // floor.width, COLORS[letter], inset=0.04)
    items = [cell for cell, count in zip(floor.shelves, task.wanted, strict=True) if count]
    for cell in (*items, *task.lying):
        canvas.fill(cell % floor.width, cell // floor.width, drawing.RED, inset=0.3)
    for cell, agent in task.stands.items():
        robot, x, y = task.robots[agent], cell % floor.width, cell // floor.width
        canvas.disc(x, y, ROBOTS[robot.role])
        if robot.load != NOWHERE:
            canvas.fill(x, y, drawing.RED, inset=0.36)
        canvas.bar(x, y, robot.battery / task.battery, drawing.INK)
    return canvas.pixels


Seen = NDArray[np.int16]

BATTERY, LACK = 4, 5
PRESENT, _EAST, _SOUTH, MOVES, RIVAL, WAYS = range(6)
CHARGER: Final = OWN + 2 * PLACE
CENTRE: Final = SIDE * SIDE // 2
STEPS: Final = (-SIDE, 1, SIDE, -1)
"""Numbers that a move adds to a position in the window."""
RESERVE: Final = 10
"""Units of battery that are kept for detours on the way to a charger."""
ENOUGH: Final = 50
"""Units of battery with which a charging robot goes back to work, if it holds so many."""
MARKED, CHARGER_KIND = 2, 4
"""First kind of cells that others may want, and the charger's kind."""
WANDER: Final = 0.1
"""Probability that a greedy robot does something else for once."""
GIVE_WAY: Final = 0.4
"""Probability to let others go first where they may want the same cell."""


def reference(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Takes goals that no other is nearer to, gives way, clears cells, recharges in time."""
    mask = info["action_mask"]
    battery, here = int(observation[BATTERY]), int(observation[KINDS_AT + CENTRE])
    if here == CHARGER_KIND and battery < ENOUGH and observation[LACK]:
        return NOOP
    if battery <= int(observation[CHARGER + MOVES]) + RESERVE:
        return _towards(observation, CHARGER, mask, rng)
    if mask[HANDLE]:
        return HANDLE
    goal = _goal(observation)
    if goal is not None:
        return _towards(observation, goal, mask, rng)
    crowded = any(observation[ROBOTS_AT + CENTRE + step] for step in STEPS)
    return _aside(observation, mask, rng) if here >= MARKED or crowded else NOOP


def greedy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Takes the nearest goal by any way, whoever is in it; wanders at times; never recharges."""
    mask = info["action_mask"]
    if mask[HANDLE]:
        return HANDLE
    moves = [move for move in range(4) if mask[move]]
    ways = [move for move in moves if observation[OWN + WAYS + move]]
    if ways and rng.random() >= WANDER:
        return ways[int(rng.integers(len(ways)))]
    return moves[int(rng.integers(len(moves)))] if moves else NOOP


def lazy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Stays where it is, and handles what is within reach."""
    return HANDLE if info["action_mask"][HANDLE] else NOOP


def _goal(seen: Seen) -> int | None:
    """Returns the first goal that no rival is nearer to; None where rivals are nearer to both."""
    for at in (OWN, OWN + PLACE):
        if seen[at + PRESENT] and seen[at + MOVES] <= seen[at + RIVAL]:
            return at
    return None


def _towards(seen: Seen, at: int, mask: Any, rng: Generator) -> int:
    """Returns a move on a shortest way into a free cell; aside at times, where there is none."""
    if not seen[at + MOVES]:  # it believes to be there and can't handle: it must be elsewhere
        return _aside(seen, mask, rng)
    ways = [move for move in range(4) if seen[at + WAYS + move] and mask[move]]
    free = [move for move in ways if not seen[ROBOTS_AT + CENTRE + STEPS[move]]]
    if not free:
        return _aside(seen, mask, rng) if rng.random() < 0.5 else NOOP
    calm = [move for move in free if not _is_contended(seen, move)]
    if calm:
        return calm[int(rng.integers(len(calm)))]
    if rng.random() < GIVE_WAY:
        return NOOP
    return free[int(rng.integers(len(free)))]


def _aside(seen: Seen, mask: Any, rng: Generator) -> int:
    """Returns any move into a free cell, before others that no other robot may want; else none."""
    moves = [move for move in range(4) if mask[move]]
    free = [move for move in moves if not seen[ROBOTS_AT + CENTRE + STEPS[move]]]
    calm = [move for move in free if not _is_contended(seen, move)]
    if not calm and rng.random() < GIVE_WAY:
        return NOOP
    chosen = calm or free
    return chosen[int(rng.integers(len(chosen)))] if chosen else NOOP


def _is_contended(seen: Seen, move: int) -> bool:
    """True if another robot stands next to the cell that the move leads to."""
    ahead = CENTRE + STEPS[move]
    return any(seen[ROBOTS_AT + ahead + step] for step in STEPS if ahead + step != CENTRE)


HORIZON: Final = 200
"""Ticks, where no horizon is given; as in the contracts."""
SLIPS: Final = {move: ((move + 1) % 4, (move + 3) % 4) for move in range(4)}
"""Moves that a move may turn into where wheels slip: to its right or left."""


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot as it is now.

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


def warehouse_kernel(*, horizon: int | None = None, **sizes: Any) -> Kernel:
    """The rules of `warehouse`; `sizes` as of `WarehouseRules`.

    Raises:
        SpecError: a number is out of its range, or the layout has too few cells.
    """
    return Kernel(
        name="warehouse_v0",
        step=work.step,
        observe=sight.observe,
        mask=sight.mask,
        inform=sight.inform,
        **shared_parts(sizes_of(**sizes), horizon, is_parallel=True),
    )


def shared_parts(sizes: Sizes, horizon: int | None, *, is_parallel: bool) -> dict[str, Any]:
    """Returns the parts that the kernels of both warehouses share."""
    horizon = HORIZON if horizon is None else horizon
    return {
        "agents": tuple(sizes.roles),
        "observation_space": sight.seen_space(sizes.layout, sizes.battery),
        "action_space": Discrete(ACTIONS),
        "state": state_of(sizes, is_parallel=is_parallel),
        "reset": work.reset,
        "plays_illegal": True,
        "info": (("position", "i8", (2,)), ("undelivered", "i8")),
        "overview": sight.overview,
        "state_space": sight.state_space(sizes),
        "tables": tables_of(sizes, sizes.layout, horizon=horizon),
        "terms": work.TERMS,
        "endings": work.ENDINGS,
        "horizon": horizon,
    }


class WarehouseRules(drawing.Pictured, Disturbed):
    """Both warehouses as PettingZoo environments: views of the state, knobs, pictures.

    Args:
        pickers, carriers: number of robots of each role at the start, 1 or more.
        spares: number of robots of each role that wait outside.
        orders: number of orders of an episode.
        every: mean ticks between two orders.
        battery: units in a full battery.
        layout: `small`, `wide`, `ring`, `hall`, or rows of text (see `warehouse_floor.py`).
        horizon: ticks after which everybody is truncated; None: the contract's.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints in them.
        **knobs: see `tasks/knobs.py`; all are off.
    Raises:
        SpecError: a number is out of its range, or the layout has too few cells.
    """

    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so
    snapshot_without = (*Disturbed.snapshot_without, "knobs", "layout", "roles", "shuffled")
    kernel_of: ClassVar[Callable[..., Kernel]]

    def __init__(
        self,
        *,
        pickers: int = 3,
        carriers: int = 2,
        spares: int = 1,
        orders: int = 8,
        every: int = 8,
        battery: int = 60,
        layout: str | tuple[str, ...] | list[str] | FloorLayout = "small",
        horizon: int | None = None,
        render_mode: str | None = None,
        debug: bool = False,
        **knobs: Unpack[KnobArguments],
    ) -> None:
        numbers = {
            "pickers": pickers,
            "carriers": carriers,
            "spares": spares,
            "orders": orders,
            "every": every,
            "battery": battery,
        }
        self.sizes = sizes_of(**numbers, layout=layout)
        self.layout = self.sizes.layout
        kernel = type(self).kernel_of(**numbers, layout=self.layout, horizon=horizon)
        super().__init__(kernel, render_mode=render_mode, debug=debug)
        self.roles, self.battery = self.sizes.roles, battery
        self.pickers, self.carriers, self.spares = pickers, carriers, spares
        self.orders, self.every = orders, every
        self.action_spaces = {agent: Discrete(ACTIONS) for agent in self.roles}
        self.knobs = Knobs(knobs, agents=self.roles)
        self.disturb(self.knobs, things=sight.THINGS, noop=NOOP, neighbours=SLIPS)

    # -- views of the state

    @property
    def floor(self) -> FloorLayout:
        """The layout of this episode."""
        knobs = self.disturbances
        return self.shuffled if knobs is not None and knobs.is_held_out else self.layout

    @property
    def robots(self) -> dict[str, Robot]:
        """All robots as they are now, spares too."""
        parts = (self.read(name).tolist() for name in ("cell", "battery", "load"))
        rows = zip(self.roles.items(), *parts, strict=True)
        return {agent: Robot(role, *numbers) for (agent, role), *numbers in rows}

    @property
    def stands(self) -> dict[int, str]:
        """The robots on the floor, by their cells."""
        there, agents = self.read("robot_at"), self.possible_agents
        return {cell: agents[there[cell] - 1] for cell in np.flatnonzero(there).tolist()}

    @property
    def wanted(self) -> NDArray[np.int16]:
        """Open orders, [shelves]; the state itself, so writing changes it."""
        return self.read("wanted")

    @property
    def lying(self) -> dict[int, int]:
        """The hand-over cells where an item lies, and the number of the shelf that it is from."""
        found = zip(self.floor.hand_overs, self.read("lying").tolist(), strict=True)
        return {cell: item - 1 for cell, item in found if item}

    @property
    def coming(self) -> list[tuple[int, int]]:
        """Tick and shelf of orders that are still to come, the next one last."""
        arrived = int(self.read("arrived"))
        orders = zip(self.read("arrival").tolist(), self.read("asked").tolist(), strict=True)
        return list(orders)[arrived:][::-1]

    @property
    def ticks(self) -> int:
        """Ticks that are over."""
        return int(self.read("clock"))

    @property
    def delivered(self) -> int:
        """Orders that are delivered."""
        return int(self.read("delivered"))

    def read(self, name: str) -> NDArray[Any]:
        """A field of the state, the state's own memory (see `warehouse_floor.state_of`)."""
        return np.asarray(self.memory.records[name][0])

    # -- observations

    def mask(self, agent: str) -> NDArray[np.int8]:
        """Actions that a robot may take now (R4), whatever the knobs; also of one that ended."""
        legal: NDArray[np.int8] = super().mask(agent)
        return legal if legal.any() else self._by_rule(sight.mask_one, agent, legal)

    def believed(self, agent: str) -> NDArray[np.int16]:
        """Observation of a robot before the knobs of perception; drift is in it."""
        if self.knobs.value("odometry_drift", agent):  # which came after the rules had looked
            return self._by_rule(sight.observe_one, agent, np.zeros(sight.LENGTH, np.int16))
        return np.asarray(super().believed(agent))

    def _by_rule(self, rule: Any, agent: str, out: NDArray[Any]) -> NDArray[Any]:
        """Returns the numbers that a rule writes about one robot."""
        s, t = Copy(self.memory.records.reshape(())), Copy(self.tables.reshape(()))
        _plainly(rule)(s, t, self.number_of[agent], out.view(Plain))
        return out

    # -- knobs

    def held_out(self, rng: Stream) -> NDArray[Any]:
        """Another floor of the same size and parts."""
        self.shuffled = self.layout.shuffled(rng)
        return tables_of(self.sizes, self.shuffled, horizon=self.kernel.horizon)

    def whereabouts(self) -> list[int]:
        """The robots' cells."""
        return list(map(int, self.read("cell")))

    def finds_itself(self, agent: str) -> bool:
        """True on all cells but open floor, which have a mark on the ground."""
        cell = int(self.read("cell")[self.number_of[agent]])
        return bool(self.tables["kinds"][0, cell])

    def strayed(self) -> None:
        """Tells the rules where robots believe to be."""
        assert self.disturbances is not None  # asked under knobs alone
        self.memory.records["drift"][0] = list(self.disturbances.drift.values())

    # -- pictures

    def letters(self) -> str:
        """Floor in letters; see `text`."""
        return text(self)

    def pixels(self) -> NDArray[np.uint8]:
        """Floor in cells of 24 pixels."""
        return picture(self)


@cache
def _plainly(rule: Any) -> Any:
    """Returns a rule as plain Python."""
    return as_python(rule)


class Warehouse(WarehouseRules, DisturbedTicks, MaskedTicks):
    """The warehouse as a Parallel environment; rules in the module's docstring."""

    metadata = metadata_of("warehouse_v0", fps=8)
    contract = "warehouse.toml"
    kernel_of = staticmethod(warehouse_kernel)
