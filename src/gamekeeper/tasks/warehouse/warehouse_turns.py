"""The warehouse by turns: all pickers act, one after the other, then all carriers.

Rules R1 to R14 of `gamekeeper.tasks.warehouse.warehouse` hold, read for one robot at a time:

    T1. A tick has a turn for each live robot: pickers first, then carriers, by their numbers. So
        every picker has settled its grasp before a carrier moves, and a carrier may take in the
        same tick what a picker has put down.
    T2. Each turn is resolved at once, alone, and all robots after it see its outcome. There are no
        ties: the first robot has the cell, or the item, and one that moves into a robot is refused
        and pays `collision`.
    T3. What follows a tick (spares, orders, "cleared") follows the last robot's turn. A spare has
        its first turn in the next tick, at its place in the order.
"""

from typing import Any

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import MaskedTurns
from gamekeeper.tasks.disturbances import DisturbedTurns
from gamekeeper.tasks.drawing import metadata_of
from gamekeeper.tasks.warehouse import warehouse_rules as work
from gamekeeper.tasks.warehouse import warehouse_sight as sight
from gamekeeper.tasks.warehouse.warehouse import WarehouseRules, shared_parts
from gamekeeper.tasks.warehouse.warehouse_floor import sizes_of


def warehouse_turns_kernel(*, horizon: int | None = None, **sizes: Any) -> Kernel:
    """The rules of `warehouse_turns`; `sizes` as of `WarehouseRules`.

    Raises:
        SpecError: a number is out of its range, or the layout has too few cells.
    """
    return Kernel(
        name="warehouse_turns_v0",
        act=work.act,
        observe=sight.observe_one,
        mask=sight.mask_one,
        inform=sight.inform_one,
        **shared_parts(sizes_of(**sizes), horizon, is_parallel=False),
    )


class WarehouseTurns(WarehouseRules, DisturbedTurns, MaskedTurns):
    """The warehouse as an AEC environment; arguments are those of `WarehouseRules`."""

    metadata = metadata_of("warehouse_turns_v0", fps=8, is_parallelizable=False)
    contract = "warehouse_turns.toml"
    kernel_of = staticmethod(warehouse_turns_kernel)
