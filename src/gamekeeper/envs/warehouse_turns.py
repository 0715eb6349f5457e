"""The warehouse by turns: all pickers act, one after the other, then all carriers.

Rules R1 to R14 of `gamekeeper.envs.warehouse` hold, read for one robot at a time:

    T1. A tick has a turn for each live robot: pickers first, then carriers, by their numbers. So
        every picker has settled its grasp before a carrier moves, and a carrier may take in the
        same tick what a picker has put down.
    T2. Each turn is resolved at once, alone, and everybody after it sees its outcome. There are no
        ties: who comes first has the cell, or the item, and who moves into a robot is refused and
        pays `collision`.
    T3. What follows a tick (spares, orders, "cleared") follows the last robot's turn. A spare has
        its first turn in the next tick, at its place in the order.
"""

from __future__ import annotations

from gamekeeper.envs import warehouse_sight as sight
from gamekeeper.envs import warehouse_work as work
from gamekeeper.envs.disturbed import DisturbedTurns
from gamekeeper.envs.layouts import Layout, layout_of
from gamekeeper.envs.warehouse import WarehouseRules, shared_parts
from gamekeeper.envs.warehouse_floor import Sizes
from gamekeeper.kernels.faces import MaskedTurns
from gamekeeper.kernels.kernel import Kernel


def warehouse_turns_kernel(
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
    """The rules of `warehouse_turns`; arguments are those of `WarehouseRules`.

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
        name="warehouse_turns_v0",
        act=work.act,
        observe=sight.observe_one,
        mask=sight.mask_one,
        inform=sight.inform_one,
        **shared_parts(sizes, horizon, is_parallel=False),
    )


class WarehouseTurns(WarehouseRules, DisturbedTurns, MaskedTurns):
    """The warehouse as an AEC environment; arguments are those of `WarehouseRules`."""

    metadata = {  # noqa: RUF012  # PettingZoo declares it so
        "name": "warehouse_turns_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 8,
        "is_parallelizable": False,
    }
    contract = "warehouse_turns.toml"
    kernel_of = staticmethod(warehouse_turns_kernel)
