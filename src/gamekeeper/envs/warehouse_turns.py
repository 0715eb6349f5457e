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

from gamekeeper.envs.warehouse import WarehouseRules
from gamekeeper.game.turn_env import TurnEnv


class WarehouseTurns(WarehouseRules, TurnEnv):
    """The warehouse as an AEC environment; arguments are those of `WarehouseRules`."""

    metadata = {  # noqa: RUF012
        "name": "warehouse_turns_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 8,
        "is_parallelizable": False,
    }
    contract = "warehouse_turns.toml"

    def act(self, agent: str, action: int) -> None:
        """One robot acts; after the last one the tick ends."""
        self.play({agent: action})
        self.is_tick_over = self._after(agent) is None
        if self.is_tick_over:
            self.end_tick()

    def next_agent(self, agent: str) -> str:
        """The next live robot in the order of possible agents, from the front after the last."""
        return self._after(None if self.is_tick_over else agent) or agent

    def _after(self, agent: str | None) -> str | None:
        """The first live robot after one of them, or of all of them; None where there is none."""
        turn = 0 if agent is None else self.turn_of[agent] + 1
        order: list[str] = self.possible_agents
        while turn < len(order):
            if order[turn] in self.rewards and order[turn] not in self.endings:
                return order[turn]
            turn += 1
        return None
