"""Small warehouses in a known state, for tests of single rules."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from gamekeeper.kernels.scalar_rules import Copy, Plain, as_python
from gamekeeper.tasks.warehouse import warehouse, warehouse_turns
from gamekeeper.tasks.warehouse import warehouse_sight as sight
from gamekeeper.tasks.warehouse.warehouse import WarehouseRules
from gamekeeper.tasks.warehouse.warehouse_floor import NOWHERE
from gamekeeper.tasks.warehouse.warehouse_rules import CARRIER, NOOP, PICKER, padded

FLOOR = ("s.....s", ".......", ".h.#.d.", ".......", "c.....c")
"""Shelf 0 is in the north-west, shelf 1 in the north-east."""
SIZED = {"pickers", "carriers", "spares", "orders", "layout"}
"""The arguments that make a kernel of another size."""


class Warehouse(warehouse.Warehouse):
    """A warehouse whose rules run as plain Python in all sizes but one: each compiles anew."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**{"debug": not SIZED.isdisjoint(given), **given})


class WarehouseTurns(warehouse_turns.WarehouseTurns):
    """The same by turns."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**{"debug": not SIZED.isdisjoint(given), **given})


def made(kind: type[Any] = Warehouse, **given: Any) -> Any:
    """A warehouse of FLOOR with two robots of each role and no orders open, just reset."""
    env = kind(**{"pickers": 2, "carriers": 2, "layout": FLOOR, **given})
    env.reset(seed=3)
    env.wanted[:] = 0
    env.memory.records["arrived"] = env.orders
    return env


def put(env: WarehouseRules, **places: tuple[int, int]) -> None:
    """Puts live robots on cells (x, y), all of them: the others go to the last row, in order."""
    width, height = env.floor.width, env.floor.height
    spare = [(x, height - 2) for x in range(width) if (x, height - 2) not in places.values()]
    env.read("robot_at")[:] = 0
    env.read("marks")[:] = 0
    table = SimpleNamespace(width=width)
    for agent in env.agents:
        x, y = places[agent] if agent in places else spare.pop()
        cell, number = y * width + x, env.number_of[agent]
        env.read("cell")[number] = cell
        env.read("robot_at")[cell] = number + 1
        mark = PICKER if env.roles[agent] == "picker" else CARRIER
        env.read("marks")[as_python(padded)(table, cell)] = mark
    looked(env)


def give(env: WarehouseRules, agent: str, shelf: int = 0) -> None:
    """Puts an item from a shelf on a robot."""
    env.read("load")[env.number_of[agent]] = shelf
    looked(env)


def charge(env: WarehouseRules, agent: str, battery: int) -> None:
    """Gives a robot so many units of battery."""
    env.read("battery")[env.number_of[agent]] = battery
    looked(env)


def lay(env: WarehouseRules, cell: int, shelf: int = 0) -> None:
    """Lays an item from a shelf on a hand-over cell."""
    env.read("lying")[env.floor.hand_overs.index(cell)] = shelf + 1
    looked(env)


def ordered(env: WarehouseRules, shelf: int, count: int = 1) -> None:
    """Opens orders at a shelf."""
    env.wanted[shelf] = count
    looked(env)


def looked(env: WarehouseRules) -> None:
    """The rules show the state as it was changed by hand: of turns they always do."""
    if isinstance(env, Warehouse):
        s, t = Copy(env.memory.records.reshape(())), Copy(env.tables.reshape(()))
        as_python(sight.observe)(s, t, env.memory.arrays.obs[0].view(Plain))
        as_python(sight.mask)(s, t, env.memory.arrays.masks[0].view(Plain))


def at(env: WarehouseRules, agent: str) -> tuple[int, int]:
    """Where a robot is, as (x, y)."""
    y, x = divmod(env.robots[agent].cell, env.floor.width)
    return x, y


def step(env: Warehouse, **actions: int) -> Any:
    """One tick, in which robots without an action do nothing: all that it returns."""
    env._forget_masks()  # the masks that were shown are of before the state was changed by hand
    return env.step({a: actions.get(a, NOOP) for a in env.agents})


def tick(env: Warehouse, **actions: int) -> dict[str, float]:
    """One tick, in which robots without an action do nothing: what each is paid."""
    rewards: dict[str, float] = step(env, **actions)[1]
    return rewards


def is_loaded(env: WarehouseRules, agent: str) -> bool:
    """Whether a robot has an item."""
    return env.robots[agent].load != NOWHERE


def rows_of(env: Any, policy: str, seed: int, *, ticks: int = 60) -> list[Any]:
    """Everything that a Parallel episode hands out, as comparable texts."""
    rng = np.random.default_rng(seed)
    act = type(env).policies[policy]
    observations, infos = env.reset(seed=seed)
    rows = [(repr(observations), repr(infos))]
    for _ in range(ticks):
        if not env.agents:
            break
        actions = {a: act(observations[a], a, infos[a], rng) for a in env.agents}
        observations, *rest, infos = env.step(actions)
        rows.append((repr(observations), repr(rest), repr(infos), repr(env.state())))
    return rows


def turns_of(env: WarehouseTurns, policy: str, seed: int) -> list[Any]:
    """Everything that an AEC episode hands out."""
    rng = np.random.default_rng(seed)
    act = type(env).policies[policy]
    env.reset(seed=seed)
    rows = []
    for agent in env.agent_iter():
        seen, reward, terminated, truncated, info = env.last()
        ended = terminated or truncated
        rows.append((agent, repr(seen), reward, terminated, truncated, repr(info)))
        env.step(None if ended else act(seen, agent, info, rng))
    return rows
