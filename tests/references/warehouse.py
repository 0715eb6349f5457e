"""`warehouse` written by hand, as a `TickEnv`; its rules R1 to R14 stand in the task itself."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Unpack

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from numpy.typing import NDArray

from gamekeeper import tasks
from gamekeeper.errors import SpecError
from gamekeeper.interface.authoring import Authored
from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.knobs import Disturbances, KnobArguments, Knobs
from gamekeeper.tasks.warehouse import warehouse as task
from gamekeeper.tasks.warehouse.warehouse import greedy, lazy, reference
from gamekeeper.tasks.warehouse.warehouse_floor import (
    CHARGER,
    DOCK,
    FLOOR,
    HAND_OVER,
    NOWHERE,
    FloorLayout,
    layout_of,
)
from tests.references.warehouse_moves import ACTIONS, HANDLE, NOOP, Robot, refused_moves
from tests.references.warehouse_sight import Sight, state_of, state_space

DELIVERY: Final = 1.0
GRASP: Final = 0.1
COLLISION: Final = -0.25
ENERGY: Final = -0.01
"""What each event pays, in reward units."""
CHARGE: Final = 5
"""Units of battery a tick on a charger gives."""
SLIPS: Final = {move: ((move + 1) % 4, (move + 3) % 4) for move in range(4)}
"""What a move may turn out as where wheels slip: a move to its right or left."""


class WarehouseRules(Authored):
    """The rules of both warehouses: state, what actions do, what a tick's end does.

    Args:
        pickers, carriers: how many robots of each role begin, 1 or more.
        spares: how many more of each role wait outside.
        orders: how many orders an episode has.
        every: mean ticks between two orders.
        battery: units in a full battery.
        layout: `small`, `wide`, `ring`, `hall`, or rows of text (see `envs/layouts.py`).
        horizon: ticks after which everybody is truncated; None: the contract's.
        render_mode: `ansi`, `rgb_array` or None.
        **knobs: see `envs/knobs.py`; all are off.
    Raises:
        SpecError: a number is out of its range, or the layout has too few cells.
    """

    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012
    snapshot_without = ("layout", "knobs", "roles", "turn_of")  # these never change

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
        **knobs: Unpack[KnobArguments],
    ) -> None:
        super().__init__(render_mode=render_mode, horizon=horizon)
        self.pickers, self.carriers, self.spares = pickers, carriers, spares
        self.orders, self.every, self.battery = orders, every, battery
        self.floor = self.layout = layout_of(layout)
        self._check_numbers()
        self.roles = {
            f"{role}_{i}": role
            for role, count in (("picker", pickers), ("carrier", carriers))
            for i in range(count + spares)
        }
        self.possible_agents = list(self.roles)
        self.turn_of = {agent: turn for turn, agent in enumerate(self.roles)}
        seen = {agent: Sight.space(self.layout, battery) for agent in self.roles}
        self.observation_spaces: dict[str, Space[Any]] = {**seen}
        self.action_spaces = {agent: Discrete(ACTIONS) for agent in self.roles}
        self.state_space: Box = state_space(self)
        self.knobs = Knobs(knobs, agents=self.roles)
        self.disturbances: Disturbances | None = None
        if not self.knobs.is_ideal:
            self.disturbances = Disturbances(
                self.knobs,
                bounds={agent: (space.low, space.high) for agent, space in seen.items()},
                things=dict.fromkeys(self.roles, Sight.things()),
                noop=NOOP,
                neighbours=SLIPS,
            )

    # -- state

    def starting_agents(self) -> list[str]:
        """Everybody but the spares."""
        first = {"picker": self.pickers, "carrier": self.carriers}
        return [a for a, role in self.roles.items() if int(a.rpartition("_")[2]) < first[role]]

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        """Robots and orders of a new episode (R2, R3)."""
        self.floor = self.layout
        if self.disturbances is not None:
            self.disturbances.begin(rng)
            if self.disturbances.is_held_out:
                self.floor = self.layout.shuffled(self.disturbances.layout_rng())
        cells = list(self.floor.floors)
        roster = self.starting_agents()
        for place in range(len(roster)):
            other = rng.integers(place, len(cells))
            cells[place], cells[other] = cells[other], cells[place]
        self.robots = {a: Robot(role, NOWHERE, self.battery) for a, role in self.roles.items()}
        self.stands: dict[int, str] = {}
        for agent, cell in zip(roster, cells, strict=False):
            self.robots[agent].cell = cell
            self.stands[cell] = agent
        self.waiting = [agent for agent in self.roles if self.robots[agent].cell == NOWHERE]
        self.lying: dict[int, int] = {}
        self.wanted: NDArray[np.int64] = np.zeros(len(self.floor.shelves), np.int64)
        self.ticks = self.delivered = 0
        self.last_tick = self._limit()
        arrivals, tick = [], 0
        for _ in range(self.orders):
            arrivals.append((tick, rng.integers(len(self.wanted))))
            tick += rng.integers(1, 2 * self.every)
        self.coming = arrivals[::-1]
        self.sight = Sight(self)
        self._take_orders()

    # -- a step

    def play(self, actions: Mapping[str, int]) -> None:
        """What some robots do at once: all of them in a tick, one in a turn (R5 to R11)."""
        knobs = self.disturbances
        played = actions if knobs is None else self._disturbed(actions, knobs)
        done = {a: action if self.robots[a].battery else NOOP for a, action in played.items()}
        self._handle([agent for agent, action in done.items() if action == HANDLE])
        self._move({agent: action for agent, action in done.items() if action < NOOP})
        for agent, action in done.items():
            robot = self.robots[agent]
            if action != NOOP:
                robot.battery -= 1
                self.add_reward(agent, ENERGY, term="energy")
            elif self.floor.text[robot.cell] == CHARGER:
                robot.battery = min(robot.battery + CHARGE, self.battery)
            if robot.battery == 0 and self.floor.text[robot.cell] != CHARGER:
                self._take_away(agent, robot)
        self.sight.look_again(actions)

    def end_tick(self) -> None:
        """What follows when everybody has acted: the end, or spares and orders (R3, R12 to R14)."""
        self.ticks += 1
        if self.delivered == self.orders:
            for agent in self.agents:
                if agent not in self.endings:
                    self.terminate(agent, "cleared")
        elif self.ticks == self.last_tick:
            for agent in self.agents:
                if agent not in self.endings:
                    self.truncate(agent, "horizon")
        elif self.waiting:
            self._let_join()
        self._take_orders()
        self.sight.look_again(self.touched.joined)

    def _disturbed(self, actions: Mapping[str, int], knobs: Disturbances) -> dict[str, int]:
        """What the actions come to under the knobs; what can't be done any more is a try (R10)."""
        for agent in actions:
            knobs.remember(agent, self.sight.view)
        return {agent: knobs.played(agent, action) for agent, action in actions.items()}

    def _handle(self, agents: list[str]) -> None:
        """Items change hands (R5 to R8)."""
        grasping: dict[int, list[str]] = {}
        delivered = 0
        for agent in agents:
            robot = self.robots[agent]
            cell, letter = robot.cell, self.floor.text[robot.cell]
            if robot.role == "picker":
                if robot.load == NOWHERE:
                    shelf = self.shelf_beside(cell)
                    if shelf != NOWHERE:
                        grasping.setdefault(shelf, []).append(agent)
                elif letter == HAND_OVER and cell not in self.lying:
                    self.lying[cell], robot.load = robot.load, NOWHERE
            elif robot.load == NOWHERE:
                robot.load = self.lying.pop(cell, NOWHERE)
            elif letter == DOCK:
                robot.load = NOWHERE
                delivered += 1
        for shelf, group in grasping.items():
            is_tie = len(group) > self.wanted[shelf]
            for agent in group:
                self.add_reward(agent, *((COLLISION, "collision") if is_tie else (GRASP, "grasp")))
                if not is_tie:
                    self.robots[agent].load = shelf
                    self.wanted[shelf] -= 1
        for _ in range(delivered):
            self.delivered += 1
            for agent in self.agents:
                if agent not in self.endings:
                    self.add_reward(agent, DELIVERY, term="delivery")

    def _move(self, moves: dict[str, int]) -> None:
        """Robots move (R9)."""
        robots, stands, ways = self.robots, self.stands, self.floor.ways
        wants: dict[str, tuple[int, int]] = {}
        for agent, move in moves.items():
            cell = robots[agent].cell
            if ways[move][cell] == NOWHERE:
                self.add_reward(agent, COLLISION, term="collision")
            else:
                wants[agent] = cell, ways[move][cell]
        refused = refused_moves(wants, stands)
        for agent, (cell, _) in wants.items():
            if agent in refused:
                self.add_reward(agent, COLLISION, term="collision")
            else:
                del stands[cell]
        for agent, (_, cell) in wants.items():
            if agent not in refused:
                robots[agent].cell = cell
                stands[cell] = agent
                if self.disturbances is not None:
                    self.disturbances.moved(agent)
                    if self.floor.text[cell] != FLOOR:
                        self.disturbances.located(agent)  # it has read the mark on the ground

    def _take_away(self, agent: str, robot: Robot) -> None:
        """An empty robot leaves, and its order is open again (R11)."""
        del self.stands[robot.cell]
        if robot.load != NOWHERE:
            self.wanted[robot.load] += 1
            robot.load = NOWHERE
        self.truncate(agent, "battery")

    def _let_join(self) -> None:
        """Spares take the places of robots that ended (R12)."""
        free = [cell for cell in self.floor.chargers if cell not in self.stands]
        live = [self.robots[agent].role for agent in self.stands.values()]
        for role, count in (("picker", self.pickers), ("carrier", self.carriers)):
            for agent in [a for a in self.waiting if self.roles[a] == role]:
                if live.count(role) < count and free:
                    cell = free.pop(0)
                    self.waiting.remove(agent)
                    self.robots[agent].cell = cell
                    self.stands[cell] = agent
                    live.append(role)
                    self.join(agent)

    def _take_orders(self) -> None:
        """Orders that have arrived are open at their shelves (R3)."""
        while self.coming and self.coming[-1][0] <= self.ticks:
            self.wanted[self.coming.pop()[1]] += 1

    def shelf_beside(self, cell: int) -> int:
        """The number of the shelf that a picker in the cell would grasp from, or NOWHERE (R5)."""
        for shelf in self.sight.shelves_beside(cell):
            if self.wanted[shelf]:
                return shelf
        return NOWHERE

    def illegal(self, agent: str, action: Any) -> int:
        """A masked action is a try (R4); one outside the space is an error."""
        if not self.action_spaces[agent].contains(action):
            raise self._refused(agent, action)
        return int(action)

    # -- what is seen

    def observe(self, agent: str) -> NDArray[np.int16]:
        """What a robot sees, [Sight.LENGTH] int16; laid out in `warehouse_sight`."""
        if self.disturbances is None:
            return self.sight.view(agent)
        return self.disturbances.shown(agent, self.sight.view)

    def mask(self, agent: str) -> NDArray[np.int8]:
        """Which actions a robot may take now (R4); true under every knob."""
        robot = self.robots[agent]
        cell, is_empty = robot.cell, robot.load == NOWHERE
        legal = np.zeros(ACTIONS, np.int8)
        legal[NOOP] = 1
        if not robot.battery or cell == NOWHERE:
            return legal
        for move in range(4):
            legal[move] = self.floor.ways[move][cell] != NOWHERE
        if robot.role == "picker":
            puts_down = self.floor.text[cell] == HAND_OVER and cell not in self.lying
            legal[HANDLE] = self.shelf_beside(cell) != NOWHERE if is_empty else puts_down
        else:
            legal[HANDLE] = cell in self.lying if is_empty else self.floor.text[cell] == DOCK
        return legal

    def info(self, agent: str) -> dict[str, Any]:
        """Where a robot really is, and how many orders are undelivered."""
        y, x = divmod(self.robots[agent].cell, self.floor.width)
        return {"position": np.array((x, y), np.int64), "undelivered": self.orders - self.delivered}

    def state(self) -> NDArray[np.int32]:
        """The whole state as whole numbers; laid out in `warehouse_sight`."""
        return state_of(self)

    def render(self) -> str | NDArray[np.uint8] | None:
        """The floor as text or as a picture."""
        if self.render_mode == "ansi":
            return task.text(self)
        return task.picture(self) if self.render_mode == "rgb_array" else None

    def _check_numbers(self) -> None:
        """Counts are whole numbers in their ranges, and there is room for everybody."""
        least = {"pickers": 1, "carriers": 1, "spares": 0, "orders": 1, "every": 1, "battery": 1}
        for name, bound in least.items():
            value = getattr(self, name)
            if type(value) is not int or not bound <= value <= 10_000:
                raise SpecError(
                    f"a warehouse can't have {name}={value!r}",
                    where=name,
                    expected=f"a whole number from {bound} to 10000",
                    actual=repr(value),
                )
        if self.pickers + self.carriers > len(self.layout.floors) // 2:
            raise SpecError(
                f"the layout {self.layout.name!r} has no room for so many robots",
                where="pickers, carriers",
                expected=f"at most {len(self.layout.floors) // 2}: half of its floor cells",
                actual=str(self.pickers + self.carriers),
                fix="take fewer robots, or layout='hall'",
            )


class Warehouse(WarehouseRules, TickEnv):
    """The warehouse as a Parallel environment; rules in the module's docstring."""

    metadata = {  # noqa: RUF012
        "name": "warehouse_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 8,
        "is_parallelizable": True,
    }
    contract = Path(tasks.__file__).parent / "warehouse" / "warehouse.toml"

    def tick(self, actions: dict[str, int]) -> None:
        """All robots act, then the tick ends."""
        self.play(actions)
        self.end_tick()
