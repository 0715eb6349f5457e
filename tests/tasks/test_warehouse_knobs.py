"""Every knob changes what it should and nothing else."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.errors import SpecError
from gamekeeper.tasks.knobs import LABELS
from gamekeeper.tasks.warehouse.warehouse_floor import layout_of
from gamekeeper.tasks.warehouse.warehouse_rules import COLLISION, EAST, ENERGY, NOOP, SOUTH, WEST
from gamekeeper.tasks.warehouse.warehouse_sight import KINDS_AT, LENGTH, OWN, PLACE, ROBOTS_AT
from tests.tasks.warehouses import (
    Warehouse,
    WarehouseTurns,
    at,
    charge,
    give,
    lay,
    made,
    put,
    rows_of,
    tick,
    turns_of,
)

IDEAL = dict.fromkeys(LABELS, 0)
SEEING = ("observation_noise", "occlusion", "observation_delay", "odometry_drift")
STRONG: dict[str, Any] = {
    "observation_noise": 2.0,
    "occlusion": 0.5,
    "observation_delay": 3,
    "odometry_drift": 0.9,
    "actuator_slip": 0.5,
    "actuator_dropout": 0.5,
    "latency": 2,
    "slowness": 2,
    "held_out": 1.0,
}


def histories(env: Warehouse, seed: int, ticks: int = 15) -> tuple[list[Any], list[Any]]:
    """Under the same random tries: what was shown, and what was so (rewards, masks, state)."""
    rng = np.random.default_rng(seed)
    observations, infos = env.reset(seed=seed)
    shown, real = [observations], [repr(infos)]
    for _ in range(ticks):
        observations, *rest, infos = env.step(
            {a: int(rng.integers(6)) for a in env.possible_agents if a in env.agents}
        )
        shown.append(observations)
        real.append((repr(rest), repr(infos), env.state().tobytes()))
    return shown, real


def test_knobs_at_their_ideal_change_nothing() -> None:
    """Rows are those of the task without knobs, also where the machinery runs for somebody."""
    given = {"battery": 1000, "horizon": 80}  # nobody runs empty, so the spare never comes
    plain = rows_of(Warehouse(**given), "greedy", 3, ticks=80)
    assert plain == rows_of(Warehouse(**given, **IDEAL), "greedy", 3, ticks=80)
    idle = {name: {"picker_3": value} for name, value in STRONG.items() if name != "held_out"}
    assert plain == rows_of(Warehouse(**given, **idle), "greedy", 3, ticks=80)
    plain = turns_of(WarehouseTurns(**given), "greedy", 3)
    assert plain == turns_of(WarehouseTurns(**given, **idle), "greedy", 3)


@pytest.mark.parametrize("name", [name for name in STRONG if name != "held_out"])
def test_knobs_leave_the_draws_of_the_rules(name: str) -> None:
    """Starts and orders of every episode are as without the knob."""
    for seed in range(3):
        drawn = []
        for knobs in ({}, {name: STRONG[name]}):
            env = Warehouse(**knobs)
            env.reset(seed=seed)
            drawn.append((env.stands, env.wanted.tolist(), env.coming, env.rng.state))
        assert drawn[0] == drawn[1]


@pytest.mark.parametrize("name", SEEING)
@pytest.mark.parametrize("whom", [None, "carrier_1"])
def test_knobs_of_seeing_change_observations_alone(name: str, whom: str | None) -> None:
    """Rewards, flags, infos, masks and states are untouched; so are the others' observations."""
    setting = STRONG[name] if whom is None else {whom: STRONG[name]}
    plain, so = histories(Warehouse(), 4)
    shown, still_so = histories(Warehouse(**{name: setting}), 4)
    assert so == still_so
    changed = {
        agent
        for before, after in zip(plain, shown, strict=True)
        for agent in before
        if not np.array_equal(before[agent], after[agent])
    }
    assert changed == (
        {"picker_0", "picker_1", "picker_2", "carrier_0", "carrier_1"} if whom is None else {whom}
    )


@pytest.mark.parametrize("name", [*SEEING, "actuator_slip", "latency"])
def test_observations_may_be_asked_for_twice(name: str) -> None:
    """What is shown hangs on the turn, not on how often it was asked for."""
    env = Warehouse(**{name: STRONG[name]})
    env.reset(seed=1)
    tick(env)
    first = env.observe("picker_0")
    assert np.array_equal(first, env.observe("picker_0"))
    _ = [env.observe("picker_0") for _ in range(3)]
    again = Warehouse(**{name: STRONG[name]})
    again.reset(seed=1)
    tick(again)
    tick(env)
    tick(again)
    assert np.array_equal(env.observe("picker_0"), again.observe("picker_0"))


def test_observation_noise_has_its_deviation() -> None:
    """A number in the middle of its range is off by about the deviation."""
    env = made(observation_noise=2.0, battery=1000)
    charge(env, "picker_0", 500)
    errors = []
    for _ in range(190):
        errors.append(int(env.observe("picker_0")[4]) - 500)
        tick(env)
    assert abs(np.mean(errors)) < 0.5
    assert 1.7 < np.std(errors) < 2.3


def test_occlusion_hides_whole_things() -> None:
    """Each goal, the charger and each robot in the window is seen whole or not at all."""
    env = Warehouse(occlusion=0.5)
    hidden = total = 0
    for seed in range(40):
        env.reset(seed=seed)
        clean, shown = env.believed("picker_0"), env.observe("picker_0")
        assert np.array_equal(clean[:OWN], shown[:OWN])
        assert np.array_equal(clean[KINDS_AT:ROBOTS_AT], shown[KINDS_AT:ROBOTS_AT])
        for first in range(OWN, KINDS_AT, PLACE):
            part = slice(first, first + PLACE)
            if clean[first]:
                is_hidden = not shown[part].any()
                assert is_hidden or np.array_equal(clean[part], shown[part])
                hidden, total = hidden + is_hidden, total + 1
        assert {*np.flatnonzero(shown[ROBOTS_AT:])} <= {*np.flatnonzero(clean[ROBOTS_AT:])}
    assert 0.3 < hidden / total < 0.7


def test_observation_delay_shows_an_earlier_turn() -> None:
    """After k ticks what is shown is what would have been shown k ticks ago; before: the first."""
    plain, _ = histories(Warehouse(), 5)
    shown, _ = histories(Warehouse(observation_delay=2), 5)
    for now, seen in enumerate(shown):
        for agent, observation in seen.items():
            assert np.array_equal(plain[max(now - 2, 0)][agent], observation)


def test_odometry_drift_moves_the_believed_cell() -> None:
    """With every move the belief is off by one more cell, until a mark on the ground is read."""
    env = made(odometry_drift=1.0)
    put(env, picker_0=(2, 1))
    assert env.observe("picker_0")[:2].tolist() == [2, 1]
    tick(env, picker_0=EAST)
    x, y = env.observe("picker_0")[:2].tolist()
    assert abs(x - 3) + abs(y - 1) == 1
    assert env.info("picker_0")["position"].tolist() == [3, 1]
    put(env, picker_0=(1, 1))
    tick(env, picker_0=SOUTH)  # onto a hand-over cell
    assert env.observe("picker_0")[:2].tolist() == [1, 2]


def test_odometry_drift_comes_with_moves_alone() -> None:
    """Who stands still, or is refused, knows where it is."""
    env = made(odometry_drift=1.0)
    put(env, picker_0=(2, 1), picker_1=(3, 1))
    tick(env, picker_0=EAST)
    assert env.observe("picker_0")[:2].tolist() == [2, 1]


def test_actuator_slip_turns_moves_aside() -> None:
    """A move turns out as one to its right or left; other actions don't slip."""
    env = made(actuator_slip=1.0, battery=1000)
    ends = set()
    for _ in range(30):
        put(env, picker_0=(4, 1))
        tick(env, picker_0=EAST)
        ends.add(at(env, "picker_0"))
    assert ends == {(4, 0), (4, 2)}
    lay(env, 15)
    put(env, carrier_0=(1, 2))
    tick(env, carrier_0=5)
    assert not env.lying


def test_actuator_slip_into_a_wall_is_a_collision() -> None:
    """What wheels do counts, not what was wanted."""
    env = made(actuator_slip=1.0)
    paid = {0.0}
    for _ in range(20):
        put(env, picker_0=(2, 2))
        paid.add(round(tick(env, picker_0=SOUTH)["picker_0"], 6))  # east of it is a wall
    assert paid == {0.0, ENERGY, round(ENERGY + COLLISION, 6)}


def test_actuator_dropout_drops_actions() -> None:
    """An action that isn't carried out costs nothing and does nothing."""
    env = made(actuator_dropout=0.5, battery=1000)
    moved = 0
    for _ in range(100):
        put(env, picker_0=(2, 1))
        paid = tick(env, picker_0=WEST)["picker_0"]
        has_moved = at(env, "picker_0") == (1, 1)
        assert paid == (ENERGY if has_moved else 0.0)
        moved += has_moved
    assert 35 < moved < 65


def test_latency_carries_actions_out_later() -> None:
    """The first k turns do nothing, then each action takes effect k turns after it was chosen."""
    env = made(latency=2)
    put(env, picker_0=(1, 1))
    seen = []
    for action in (EAST, NOOP, SOUTH, NOOP, NOOP):
        tick(env, picker_0=action)
        seen.append(at(env, "picker_0"))
    assert seen == [(1, 1), (1, 1), (2, 1), (2, 1), (2, 2)]


def test_slowness_leaves_turns_idle() -> None:
    """The slow robot acts in one turn of three, the others in all."""
    env = made(slowness={"picker_0": 2})
    put(env, picker_0=(1, 1), picker_1=(1, 3))
    for _ in range(4):
        tick(env, picker_0=EAST, picker_1=EAST)
    assert at(env, "picker_0") == (3, 1)
    assert at(env, "picker_1") != (1, 3)


def test_held_out_shuffles_the_floor() -> None:
    """Episodes take place on other floors of the same size and parts, with the same probability."""
    env = Warehouse(held_out=0.5)
    other = []
    for seed in range(30):
        env.reset(seed=seed)
        other.append(env.floor.rows != layout_of("small").rows)
        assert sorted(env.floor.text) == sorted(layout_of("small").text)
        assert env.observe("picker_0").shape == (LENGTH,)
    assert 6 < sum(other) < 24
    first = env.floor
    env.reset(seed=29)
    assert env.floor == first


@pytest.mark.parametrize("kind", [Warehouse, WarehouseTurns])
def test_knobs_hold_by_role_and_agent(kind: type[Any]) -> None:
    """A dictionary names roles and agents; an agent's own value goes before its role's."""
    env = kind(latency={"picker": 2, "picker_1": 1})
    values = {a: env.knobs.value("latency", a) for a in env.possible_agents}
    assert values == {
        **dict.fromkeys(("picker_0", "picker_2", "picker_3"), 2),
        "picker_1": 1,
        **dict.fromkeys(("carrier_0", "carrier_1", "carrier_2"), 0),
    }


@pytest.mark.parametrize(
    "wrong",
    [
        {"latency": 0.5},
        {"latency": -1},
        {"occlusion": 1.5},
        {"occlusion": float("nan")},
        {"observation_noise": "much"},
        {"actuator_slip": True},
        {"actuator_slip": {"dog": 0.1}},
        {"actuator_slip": {"picker_0": 2.0}},
        {"actuator_drift": 0.1},
        {"held_out": {"picker": 1.0}},
    ],
)
def test_knobs_that_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    """Unknown knobs, values out of range and strangers are errors that name them."""
    with pytest.raises(SpecError, match=next(iter(wrong))):
        Warehouse(**wrong)


def test_delay_holds_by_turns_too() -> None:
    """In turns, what is shown is what the same robot would have been shown k of its turns ago."""
    clean: list[Any] = []
    env = made(WarehouseTurns, observation_delay=1)
    give(env, "picker_0")
    for turn in range(12):
        agent = env.agent_selection
        if agent == "picker_0":
            shown = env.observe(agent)
            assert np.array_equal(shown, clean[-1] if clean else env.believed(agent))
            clean.append(env.believed(agent))
        legal = np.flatnonzero(env.infos[agent]["action_mask"])
        env.step(int(legal[turn % len(legal)]))
