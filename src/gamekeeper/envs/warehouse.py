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
    R6. Where more pickers grasp from a shelf than it has open orders, none of them gets anything
        and each pays `collision`.
    R7. A carrier handles: without an item, on a hand-over cell where one lies, it takes it; with an
        item, on a dock, it delivers it, and every live robot is paid `delivery`.
    R8. Handling looks at the cells as the tick began; robots that handle don't move.
    R9. Moves are resolved together, whatever the order of the actions. Refused are all who want one
        cell, who want the cell of a robot that stays, both who would swap, and who wants the cell
        of one that is refused; and who would leave the open cells. A queue moves on behind one
        that moves, and a ring of three or more turns. Who is refused stays and pays `collision`;
        who was run into pays nothing.
Batteries
    R10. A tick in which a robot moves, tries to, or handles costs one unit of its battery, and it
        pays `energy`; a tick in which it does nothing on a charger gives CHARGE units. With an
        empty battery everything but doing nothing is masked out, and comes to nothing.
    R11. A robot whose battery is empty, and that is on no charger, is truncated alone ("battery")
        and taken off the floor; the order of the item it had is open again at its shelf.
    R12. After each tick, for each role, where fewer robots are live than the episode began with,
        the next spare joins on the first charger without a robot, if there is one.
Ends
    R13. When all orders are delivered, after the tick, everybody is terminated ("cleared").
    R14. After `horizon` ticks (the contract's, 200, unless given) all are truncated ("horizon").

An episode is solved where it ends "cleared". The shape of the task, robots that contend for cells
on a grid and deliver requested items, is that of RWARE (Papoudakis et al. 2021, "Benchmarking
Multi-Agent Deep Reinforcement Learning Algorithms in Cooperative Tasks"); rules, roles, batteries
and rewards are our own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Final, Unpack

import numpy as np
from gymnasium.spaces import Discrete
from numpy.typing import NDArray

from gamekeeper.core.stream import Stream
from gamekeeper.envs import warehouse_picture as picture
from gamekeeper.envs import warehouse_sight as sight
from gamekeeper.envs import warehouse_work as work
from gamekeeper.envs.disturbed import Disturbed, DisturbedTicks
from gamekeeper.envs.knobs import KnobArguments, Knobs
from gamekeeper.envs.layouts import NOWHERE, Layout, layout_of
from gamekeeper.envs.warehouse_floor import Sizes, state_of, tables_of
from gamekeeper.envs.warehouse_moves import ACTIONS, NOOP
from gamekeeper.envs.warehouse_policies import greedy, lazy, reference
from gamekeeper.kernels.faces import MaskedTicks
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.rules import Copy, Plain, as_python

HORIZON: Final = 200
"""Ticks, where no horizon is given; as in the contracts."""
SLIPS: Final = {move: ((move + 1) % 4, (move + 3) % 4) for move in range(4)}
"""What a move may turn out as where wheels slip: a move to its right or left."""


@dataclass(frozen=True, slots=True)
class Robot:
    """What a robot is and has, as it was when asked for.

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


def warehouse_kernel(
    *,
    pickers: int = 3,
    carriers: int = 2,
    spares: int = 1,
    orders: int = 8,
    every: int = 8,
    battery: int = 60,
    layout: str | tuple[str, ...] | list[str] | Layout = "small",
    horizon: int | None = None,
) -> Kernel:
    """The rules of `warehouse`; arguments are those of `WarehouseRules`.

    Raises:
        SpecError: a number is out of its range, or the layout has too few cells.
    """
    sizes = Sizes(
        pickers=pickers,
        carriers=carriers,
        spares=spares,
        orders=orders,
        every=every,
        battery=battery,
        layout=layout_of(layout),
    )
    return Kernel(
        name="warehouse_v0",
        step=work.step,
        observe=sight.observe,
        mask=sight.mask,
        inform=sight.inform,
        **shared_parts(sizes, horizon, is_parallel=True),
    )


def shared_parts(sizes: Sizes, horizon: int | None, *, is_parallel: bool) -> dict[str, Any]:
    """What the kernels of both warehouses have in common."""
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


class WarehouseRules(Disturbed):
    """Both warehouses as PettingZoo has them: the state told, knobs, pictures.

    Args:
        pickers, carriers: how many robots of each role begin, 1 or more.
        spares: how many more of each role wait outside.
        orders: how many orders an episode has.
        every: mean ticks between two orders.
        battery: units in a full battery.
        layout: `small`, `wide`, `ring`, `hall`, or rows of text (see `envs/layouts.py`).
        horizon: ticks after which everybody is truncated; None: the contract's.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints in them.
        **knobs: see `envs/knobs.py`; all are off.
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
        layout: str | tuple[str, ...] | list[str] | Layout = "small",
        horizon: int | None = None,
        render_mode: str | None = None,
        debug: bool = False,
        **knobs: Unpack[KnobArguments],
    ) -> None:
        self.layout = layout_of(layout)
        numbers = {
            "pickers": pickers, "carriers": carriers, "spares": spares,
            "orders": orders, "every": every, "battery": battery,
        }  # fmt: skip
        kernel = type(self).kernel_of(**numbers, layout=self.layout, horizon=horizon)
        super().__init__(kernel, render_mode=render_mode, debug=debug)
        self.sizes = Sizes(**numbers, layout=self.layout)
        self.roles, self.battery = self.sizes.roles, battery
        self.pickers, self.carriers, self.spares = pickers, carriers, spares
        self.orders, self.every = orders, every
        self.action_spaces = {agent: Discrete(ACTIONS) for agent in self.roles}
        self.knobs = Knobs(knobs, agents=self.roles)
        self.disturb(self.knobs, things=sight.THINGS, noop=NOOP, neighbours=SLIPS)

    # -- the state, told

    @property
    def floor(self) -> Layout:
        """The layout of this episode."""
        knobs = self.disturbances
        return self.shuffled if knobs is not None and knobs.is_held_out else self.layout

    @property
    def robots(self) -> dict[str, Robot]:
        """What each robot is and has, spares too."""
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
        field: NDArray[Any] = self.bench.records[name][0]
        return field

    # -- what is seen

    def mask(self, agent: str) -> NDArray[np.int8]:
        """Which actions a robot may take now (R4); true under every knob, and of who ended."""
        legal: NDArray[np.int8] = super().mask(agent)
        return legal if legal.any() else self._by_rule(sight.mask_one, agent, legal)

    def believed(self, agent: str) -> NDArray[np.int16]:
        """What a robot sees but for the knobs of perception; drift is in it."""
        if self.knobs.value("odometry_drift", agent):  # which came after the rules had looked
            return self._by_rule(sight.observe_one, agent, np.zeros(sight.LENGTH, np.int16))
        seen: NDArray[np.int16] = super().believed(agent)
        return seen

    def _by_rule(self, rule: Any, agent: str, out: NDArray[Any]) -> NDArray[Any]:
        """What a rule writes about a robot, asked by itself."""
        s, t = Copy(self.bench.records.reshape(())), Copy(self.tables.reshape(()))
        _plainly(rule)(s, t, self.number_of[agent], out.view(Plain))
        return out

    # -- knobs

    def held_out(self, rng: Stream) -> NDArray[Any]:
        """Another floor of the same size and parts."""
        self.shuffled = self.layout.shuffled(rng)
        return tables_of(self.sizes, self.shuffled, horizon=self.kernel.horizon)

    def whereabouts(self) -> list[int]:
        """The robots' cells."""
        cells: list[int] = self.read("cell").tolist()
        return cells

    def finds_itself(self, agent: str) -> bool:
        """All but open floor has a mark on the ground."""
        cell = int(self.read("cell")[self.number_of[agent]])
        return bool(self.tables["kinds"][0, cell])

    def strayed(self) -> None:
        """The rules show where robots believe to be."""
        assert self.disturbances is not None  # asked under knobs alone
        self.bench.records["drift"][0] = list(self.disturbances.drift.values())

    # -- pictures

    def render(self) -> str | NDArray[np.uint8] | None:
        """The floor as text or as a picture."""
        return picture.draw(self) if self.render_mode else None


@cache
def _plainly(rule: Any) -> Any:
    """A rule as plain Python."""
    return as_python(rule)


class Warehouse(WarehouseRules, DisturbedTicks, MaskedTicks):
    """The warehouse as a Parallel environment; rules in the module's docstring."""

    metadata = {  # noqa: RUF012  # PettingZoo declares it so
        "name": "warehouse_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 8,
        "is_parallelizable": True,
    }
    contract = "warehouse.toml"
    kernel_of = staticmethod(warehouse_kernel)
