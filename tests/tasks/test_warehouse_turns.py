"""The warehouse by turns: what its rules say beyond the Parallel one's."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.tasks.warehouse.warehouse_rules import (
    COLLISION,
    EAST,
    ENERGY,
    HANDLE,
    NOOP,
    NORTH,
    SOUTH,
    WEST,
)
from tests.tasks.warehouses import WarehouseTurns, at, charge, give, is_loaded, made, ordered, put


@pytest.fixture
def env() -> Any:
    """A small floor with two robots of each role and no open orders."""
    return made(WarehouseTurns)


def play(env: WarehouseTurns, *actions: int) -> None:
    """The next turns."""
    for action in actions:
        env._forget_masks()  # the masks that were shown are of before the state was changed by hand
        env.step(action)


def test_t1_pickers_act_before_carriers(env: Any) -> None:
    """A tick is a turn of each live robot, in the order of possible agents."""
    turns = []
    for _ in range(8):
        turns.append(env.agent_selection)
        play(env, NOOP)
    assert turns == ["picker_0", "picker_1", "carrier_0", "carrier_1"] * 2
    assert env.ticks == 2


def test_t1_carrier_takes_what_a_picker_put_down(env: Any) -> None:
    """A hand-over cell that a picker has left can be entered in the same tick."""
    give(env, "picker_0")
    put(env, picker_0=(1, 2), carrier_0=(1, 3))
    play(env, HANDLE, NOOP, NOOP, NOOP)
    play(env, NORTH, NOOP, NORTH, NOOP)
    assert at(env, "carrier_0") == (1, 2)
    play(env, NOOP, NOOP, HANDLE)
    assert is_loaded(env, "carrier_0")


def test_t2_who_comes_first_has_the_cell(env: Any) -> None:
    """No tie: the first picker moves in, the second is refused and pays."""
    put(env, picker_0=(1, 1), picker_1=(3, 1))
    play(env, EAST)
    assert env.rewards["picker_0"] == ENERGY
    play(env, WEST)
    assert env.rewards["picker_1"] == pytest.approx(ENERGY + COLLISION)
    assert (at(env, "picker_0"), at(env, "picker_1")) == ((2, 1), (3, 1))


def test_t2_who_comes_first_has_the_item(env: Any) -> None:
    """Two pickers at one order: after the first grasp the second's is masked out."""
    put(env, picker_0=(1, 0), picker_1=(0, 1))
    ordered(env, 0)
    play(env, HANDLE)
    assert is_loaded(env, "picker_0")
    assert env.infos["picker_1"]["action_mask"][HANDLE] == 0


def test_t3_a_spare_acts_from_the_next_tick(env: Any) -> None:
    """It joins after the last turn of the tick, and has its place among its role."""
    put(env, picker_0=(3, 0))
    charge(env, "picker_0", 1)
    play(env, EAST, None)  # it ends, and has its last turn
    assert "picker_2" not in env.agents
    assert env.agent_selection == "picker_1"
    play(env, NOOP, NOOP, NOOP)
    assert "picker_2" in env.agents
    turns = []
    for _ in range(4):
        turns.append(env.agent_selection)
        play(env, NOOP)
    assert turns == ["picker_1", "picker_2", "carrier_0", "carrier_1"]


def test_t3_the_end_is_looked_at_after_the_tick() -> None:
    """With all orders delivered the rest of the tick is played, then all are terminated."""
    env = made(WarehouseTurns, orders=1)
    give(env, "carrier_0")
    put(env, carrier_0=(5, 2))
    play(env, NOOP, NOOP, HANDLE)
    assert not env.endings
    play(env, NOOP)
    assert set(env.endings.values()) == {"cleared"}


def test_t3_the_last_robot_s_end_ends_the_tick() -> None:
    """Where the last robot in the order runs empty, the tick still ends, and a spare comes."""
    env = made(WarehouseTurns, pickers=1, carriers=1)
    put(env, picker_0=(1, 1), carrier_0=(3, 1))
    charge(env, "carrier_0", 1)
    play(env, NOOP, SOUTH if env.mask("carrier_0")[SOUTH] else NORTH)
    assert env.ticks == 1
    assert env.agents == ["picker_0", "carrier_0", "carrier_1"]
    play(env, None)
    assert env.agent_selection == "picker_0"


@pytest.mark.parametrize("battery", [9, 60])
def test_r14_every_episode_has_its_horizon(battery: int) -> None:
    """Ticks are counted right also where robots end and join on the way."""
    env = WarehouseTurns(battery=battery, spares=3, horizon=30, orders=20)
    rng = np.random.default_rng(4)
    env.reset(seed=4)
    for agent in env.agent_iter():
        seen, _, terminated, truncated, info = env.last()
        act = WarehouseTurns.policies["greedy" if agent.startswith("picker") else "lazy"]
        env.step(None if terminated or truncated else act(seen, agent, info, rng))
    assert env.ticks == 30
    assert "horizon" in env.endings.values()
    assert ("battery" in env.endings.values()) == (battery == 9)
