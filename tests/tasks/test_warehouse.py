"""The rules of the warehouse, one test for each that is written."""

import itertools
from typing import Any

import numpy as np
import pytest

from gamekeeper.errors import ActionError, SpecError
from gamekeeper.tasks.warehouse.warehouse_rules import (
    CHARGE,
    COLLISION,
    DELIVERY,
    EAST,
    ENERGY,
    GRASP,
    HANDLE,
    NOOP,
    NORTH,
    SOUTH,
    WEST,
)
from tests.tasks.warehouses import (
    Warehouse,
    at,
    charge,
    give,
    is_loaded,
    lay,
    made,
    ordered,
    put,
    step,
    tick,
)


@pytest.fixture
def env() -> Any:
    """A small floor with two robots of each role and no open orders."""
    return made()


def test_r1_robots_drive_on_open_cells_alone(env: Any) -> None:
    """Walls, shelves and the outside are masked out, hand-over cells aren't."""
    put(env, picker_0=(1, 0), picker_1=(2, 2), carrier_0=(0, 4))
    assert env.mask("picker_0").tolist() == [0, 1, 1, 0, 1, 0]
    assert env.mask("picker_1").tolist() == [1, 0, 1, 1, 1, 0]
    assert env.mask("carrier_0").tolist() == [1, 1, 0, 0, 1, 0]


def test_r1_cells_hold_one_robot_at_most() -> None:
    """Under random play in a crowd no two robots are ever in one cell."""
    env = Warehouse(pickers=10, carriers=10)
    rng = np.random.default_rng(1)
    _, infos = env.reset(seed=1)
    while env.agents:
        legal = {a: np.flatnonzero(infos[a]["action_mask"]) for a in env.agents}
        *_, infos = env.step({a: int(rng.choice(legal[a])) for a in env.agents})
        assert len(env.stands) == len(env.agents)
        assert len({tuple(infos[a]["position"]) for a in env.agents}) == len(env.agents)


def test_r2_robots_begin_charged_on_floor_cells() -> None:
    """Starts are random floor cells, batteries full, spares outside."""
    env = Warehouse()
    env.reset(seed=5)
    assert env.agents == ["picker_0", "picker_1", "picker_2", "carrier_0", "carrier_1"]
    assert {"."} == {env.floor.text[cell] for cell in env.stands}
    assert {60} == {robot.battery for robot in env.robots.values()}
    first = dict(env.stands)
    env.reset(seed=6)
    assert first != env.stands


def test_r3_orders_arrive_by_themselves() -> None:
    """The first order is there at once, the next within 2 `every` - 1 ticks, whatever robots do."""
    arrivals = []
    for policy in ("lazy", "greedy"):
        env = Warehouse(orders=5, every=4)
        env.reset(seed=2)
        arrivals.append([(0, int(np.flatnonzero(env.wanted)[0])), *env.coming[::-1]])
        observations, infos = env.reset(seed=2)
        rng = np.random.default_rng(0)
        act = Warehouse.policies[policy]
        while env.coming:
            due = env.coming[-1][0]
            observations, *_, infos = env.step(
                {a: act(observations[a], a, infos[a], rng) for a in env.agents}
            )
            assert env.ticks <= due or not env.coming or env.coming[-1][0] != due
    assert arrivals[0] == arrivals[1]
    gaps = [b[0] - a[0] for a, b in itertools.pairwise(arrivals[0])]
    assert len(gaps) == 4
    assert all(1 <= gap <= 7 for gap in gaps)


def test_r4_masked_actions_are_tries(env: Any) -> None:
    """Against a shelf a robot stays and pays; handling nothing costs battery alone."""
    put(env, picker_0=(1, 0), carrier_0=(5, 2))
    paid = tick(env, picker_0=NORTH, carrier_0=HANDLE)
    assert at(env, "picker_0") == (1, 0)
    assert paid["picker_0"] == pytest.approx(COLLISION + ENERGY)
    assert paid["carrier_0"] == ENERGY
    assert env.robots["carrier_0"].battery == 59


@pytest.mark.parametrize("wrong", [6, -1, None, "north", 1.0])
def test_r4_actions_outside_the_space_are_refused(env: Any, wrong: Any) -> None:
    """What is no action at all is an error that leaves the tick unplayed."""
    with pytest.raises(ActionError, match="picker_0"):
        tick(env, picker_0=wrong)
    assert env.ticks == 0


def test_r4_actions_move_as_they_are_called(env: Any) -> None:
    """North is up the rows, east along them."""
    put(env, picker_0=(4, 1), picker_1=(1, 1))
    tick(env, picker_0=NORTH, picker_1=EAST)
    assert (at(env, "picker_0"), at(env, "picker_1")) == ((4, 0), (2, 1))
    tick(env, picker_0=SOUTH, picker_1=WEST)
    assert (at(env, "picker_0"), at(env, "picker_1")) == ((4, 1), (1, 1))


def test_r5_pickers_grasp_and_put_down(env: Any) -> None:
    """A picker beside an ordered shelf grasps and is paid; on a hand-over cell it puts down."""
    put(env, picker_0=(1, 0))
    ordered(env, 0)
    assert env.mask("picker_0")[HANDLE] == 1
    assert pytest.approx(GRASP + ENERGY) == tick(env, picker_0=HANDLE)["picker_0"]
    assert is_loaded(env, "picker_0")
    assert env.wanted[0] == 0
    put(env, picker_0=(1, 2))
    assert pytest.approx(ENERGY) == tick(env, picker_0=HANDLE)["picker_0"]
    assert env.lying == {15: 0}
    give(env, "picker_0")
    assert env.mask("picker_0")[HANDLE] == 0  # an item lies there


def test_r5_picker_takes_the_first_shelf_around() -> None:
    """Of several ordered shelves beside it, the one to the north comes before the east."""
    env = made(layout=(".s..", "..sh", "d..c"), pickers=1, carriers=1)
    put(env, picker_0=(1, 1))
    env.wanted[:] = 1
    tick(env, picker_0=HANDLE)
    assert env.robots["picker_0"].load == 0
    assert env.wanted.tolist() == [0, 1]


def test_r6_too_many_grasps_are_a_tie(env: Any) -> None:
    """Two pickers at one order both pay and have nothing; with two orders both are served."""
    put(env, picker_0=(1, 0), picker_1=(0, 1))
    ordered(env, 0)
    paid = tick(env, picker_0=HANDLE, picker_1=HANDLE)
    assert pytest.approx(COLLISION + ENERGY) == paid["picker_0"]
    assert paid["picker_0"] == paid["picker_1"]
    assert env.wanted[0] == 1
    ordered(env, 0, 2)
    tick(env, picker_0=HANDLE, picker_1=HANDLE)
    assert is_loaded(env, "picker_0")
    assert is_loaded(env, "picker_1")


def test_r7_carriers_take_and_deliver(env: Any) -> None:
    """A carrier takes what lies on a hand-over cell; at a dock everybody is paid for it."""
    put(env, carrier_0=(1, 2))
    lay(env, 15)
    tick(env, carrier_0=HANDLE)
    assert is_loaded(env, "carrier_0")
    assert not env.lying
    put(env, carrier_0=(5, 2))
    paid = tick(env, carrier_0=HANDLE)
    assert not is_loaded(env, "carrier_0")
    assert pytest.approx(DELIVERY + ENERGY) == paid.pop("carrier_0")
    assert {DELIVERY} == set(paid.values())
    assert env.terms["picker_0"] == {"delivery": DELIVERY}


def test_r7_roles_handle_their_own_things_alone(env: Any) -> None:
    """A carrier can't grasp from a shelf, a picker can't take from a hand-over cell or deliver."""
    ordered(env, 0)
    lay(env, 15)
    give(env, "picker_1")
    put(env, carrier_0=(1, 0), picker_0=(1, 2), picker_1=(5, 2))
    assert [env.mask(a)[HANDLE] for a in ("carrier_0", "picker_0", "picker_1")] == [0, 0, 0]


def test_r8_handling_looks_at_the_tick_s_beginning(env: Any) -> None:
    """Who handles stays, so who moves into its cell is refused."""
    give(env, "picker_0")
    put(env, picker_0=(1, 2), carrier_0=(1, 3))
    paid = tick(env, picker_0=HANDLE, carrier_0=NORTH)
    assert pytest.approx(COLLISION + ENERGY) == paid["carrier_0"]
    assert at(env, "carrier_0") == (1, 3)
    assert 15 in env.lying


@pytest.mark.parametrize("order", list(itertools.permutations(range(4)))[::5])
def test_r9_collisions_do_not_hang_on_the_order_of_actions(order: tuple[int, ...]) -> None:
    """A tie, a swap and a robot run into: the same outcome for every order of the dictionary."""
    env = made(carriers=2)
    put(env, picker_0=(1, 1), picker_1=(3, 1), carrier_0=(2, 0), carrier_1=(4, 1))
    wanted = [("picker_0", EAST), ("picker_1", WEST), ("carrier_0", NOOP), ("carrier_1", WEST)]
    paid = tick(env, **dict(wanted[i] for i in order))
    refused = pytest.approx(COLLISION + ENERGY)
    assert [refused, refused, 0.0, refused] == [paid[a] for a, _ in wanted]
    assert [at(env, a) for a, _ in wanted] == [(1, 1), (3, 1), (2, 0), (4, 1)]


def test_r9_queues_move_on(env: Any) -> None:
    """Behind a robot that moves its followers do, and nobody pays."""
    put(env, picker_0=(1, 1), picker_1=(2, 1), carrier_0=(3, 1), carrier_1=(5, 4))
    paid = tick(env, picker_0=EAST, picker_1=EAST, carrier_0=EAST)
    assert [at(env, a) for a in ("picker_0", "picker_1", "carrier_0")] == [(2, 1), (3, 1), (4, 1)]
    assert {ENERGY, 0.0} == set(paid.values())


def test_r10_work_costs_battery_and_chargers_fill_it(env: Any) -> None:
    """A move, tried or done, costs a unit; doing nothing costs none and gains some on a charger."""
    put(env, picker_0=(0, 4), picker_1=(3, 0), carrier_0=(4, 0))
    charge(env, "picker_0", 20)
    paid = tick(env, picker_1=EAST)
    assert pytest.approx(ENERGY + COLLISION) == paid["picker_1"]
    assert [env.robots[a].battery for a in ("picker_0", "picker_1", "carrier_0")] == [
        20 + CHARGE,
        59,
        60,
    ]
    charge(env, "picker_0", 59)
    tick(env)
    assert env.robots["picker_0"].battery == 60


def test_r10_an_empty_robot_can_do_nothing() -> None:
    """On a charger with an empty battery only doing nothing is legal; then it goes on."""
    env = made()
    put(env, picker_0=(0, 4))
    charge(env, "picker_0", 0)
    assert env.mask("picker_0").tolist() == [0, 0, 0, 0, 1, 0]
    assert tick(env, picker_0=NORTH)["picker_0"] == 0.0
    assert at(env, "picker_0") == (0, 4)
    assert env.robots["picker_0"].battery == CHARGE


def test_r11_an_empty_robot_is_truncated_alone(env: Any) -> None:
    """It leaves the floor, its order is open again, and the others go on."""
    give(env, "carrier_0", shelf=1)
    put(env, carrier_0=(3, 1))
    charge(env, "carrier_0", 1)
    _, _, terminated, truncated, _ = step(env, carrier_0=EAST)
    assert env.endings == {"carrier_0": "battery"}
    assert truncated["carrier_0"]
    assert not any(terminated.values())
    assert env.wanted[1] == 1
    assert "carrier_0" not in env.stands.values()
    assert env.agents == ["picker_0", "picker_1", "carrier_1", "carrier_2"]


def test_r11_the_last_unit_may_reach_a_charger(env: Any) -> None:
    """A robot that arrives at a charger with an empty battery isn't truncated."""
    put(env, picker_0=(0, 3), picker_1=(1, 0))
    charge(env, "picker_0", 1)
    tick(env, picker_0=SOUTH)
    assert not env.endings
    assert env.robots["picker_0"].battery == 0


def test_r12_a_spare_joins_for_one_that_ended(env: Any) -> None:
    """It stands on the first free charger with a full battery, and acts from the next tick."""
    put(env, carrier_0=(3, 1), picker_0=(0, 4))
    charge(env, "carrier_0", 1)
    observations, *_ = step(env, carrier_0=EAST)
    assert at(env, "carrier_2") == (6, 4)  # picker_0 is on the first charger
    assert env.robots["carrier_2"].battery == 60
    assert {"carrier_0", "carrier_2"} <= set(observations)
    tick(env, carrier_2=WEST)
    assert at(env, "carrier_2") == (5, 4)


def test_r12_spares_wait_for_a_free_charger(env: Any) -> None:
    """While robots stand on all chargers nobody joins; then one does."""
    put(env, carrier_0=(3, 1), picker_0=(0, 4), picker_1=(6, 4))
    charge(env, "carrier_0", 1)
    tick(env, carrier_0=EAST)
    assert "carrier_2" not in env.agents
    tick(env, picker_0=NORTH)
    assert at(env, "carrier_2") == (0, 4)


def test_r12_there_are_never_more_than_began() -> None:
    """However many end, live robots of a role are at most as many as at the start."""
    env = Warehouse(battery=12, spares=4)
    rng = np.random.default_rng(4)
    observations, infos = env.reset(seed=4)
    joined = 0
    while env.agents:
        actions = {
            a: Warehouse.policies["greedy"](observations[a], a, infos[a], rng) for a in env.agents
        }
        observations, *_, infos = env.step(actions)
        joined += len(env.touched.joined)
        roles = [agent.split("_")[0] for agent in env.agents]
        assert roles.count("picker") <= 3
        assert roles.count("carrier") <= 2
    assert joined == 8


def test_r13_all_orders_delivered_terminate_everybody() -> None:
    """The tick of the last delivery ends all as cleared, with its reward."""
    env = made(orders=1)
    give(env, "carrier_0")
    put(env, carrier_0=(5, 2))
    _, rewards, terminated, truncated, infos = step(env, carrier_0=HANDLE)
    assert env.agents == []
    assert {"cleared"} == set(env.endings.values())
    assert all(terminated.values())
    assert not any(truncated.values())
    assert rewards["picker_0"] == DELIVERY
    assert infos["picker_0"]["undelivered"] == 0


@pytest.mark.parametrize("horizon", [7, None])
def test_r14_the_time_limit_truncates(horizon: int | None) -> None:
    """After the horizon (200 by contract) all who are left are truncated."""
    env = Warehouse(horizon=horizon)
    env.reset(seed=1)
    while env.agents:
        tick(env)
    assert (horizon or 200) == env.ticks
    assert {"horizon"} == set(env.endings.values())


@pytest.mark.parametrize(
    "wrong",
    [
        {"pickers": 0},
        {"carriers": 2.0},
        {"spares": -1},
        {"orders": True},
        {"pickers": 100},
        {"layout": "smal"},
        {"layout": ("s.h", "dc")},
        {"layout": 3},
    ],
)
def test_arguments_that_make_no_warehouse_are_refused(wrong: dict[str, Any]) -> None:
    """Counts and layouts that can't be are errors that name the argument."""
    with pytest.raises(SpecError):
        Warehouse(**wrong)
