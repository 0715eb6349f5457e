"""`warehouse_turns` written by hand, as a `TurnEnv`; rules T1 to T3 stand in the task itself."""

from pathlib import Path

from gamekeeper import tasks
from gamekeeper.interface.turn_env import TurnEnv
from tests.references.warehouse import WarehouseRules


class WarehouseTurns(WarehouseRules, TurnEnv):
    """The warehouse as an AEC environment; arguments are those of `WarehouseRules`."""

    metadata = {  # noqa: RUF012
        "name": "warehouse_turns_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 8,
        "is_parallelizable": False,
    }
    contract = Path(tasks.__file__).parent / "warehouse" / "warehouse_turns.toml"

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
