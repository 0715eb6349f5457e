"""What both warehouses promise as environments: PettingZoo's tests, spaces, seeds, copies, size."""

import copy
import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pettingzoo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pettingzoo.test import (
    api_test,
    max_cycles_test,
    parallel_api_test,
    parallel_seed_test,
    render_test,
    seed_test,
    state_test,
)
from pettingzoo.utils.conversions import parallel_to_aec

import gamekeeper as gk
from gamekeeper.tasks.warehouse import warehouse, warehouse_turns
from gamekeeper.tasks.warehouse.warehouse_floor import CLOSED, NAMED, NOWHERE
from gamekeeper.tasks.warehouse.warehouse_rules import ENERGY
from tests.tasks.warehouses import Warehouse, WarehouseTurns, rows_of, turns_of

BOTH = pytest.mark.parametrize("kind", [Warehouse, WarehouseTurns])
EVERY_KNOB: dict[str, Any] = {
    "observation_noise": 2.0,
    "occlusion": 0.3,
    "observation_delay": 2,
    "odometry_drift": 0.2,
    "actuator_slip": 0.2,
    "actuator_dropout": 0.1,
    "latency": 1,
    "slowness": {"carrier_0": 1},
    "held_out": 0.5,
}


@pytest.mark.parametrize("given", [{}, {"battery": 15}], ids=["plain", "dying"])
def test_warehouse_passes_the_parallel_api_test(given: dict[str, Any]) -> None:
    """PettingZoo's Parallel API test finds nothing, with robots that end and join too."""
    parallel_api_test(Warehouse(**given), num_cycles=300)


@pytest.mark.parametrize("given", [{}, {"battery": 15}], ids=["plain", "dying"])
def test_warehouse_turns_passes_the_api_test(given: dict[str, Any]) -> None:
    """PettingZoo's AEC API test finds nothing, with robots that end and join too."""
    api_test(WarehouseTurns(**given), num_cycles=500)


def test_warehouses_pass_the_seed_tests() -> None:
    """The same seed gives the same game, again and in another instance."""
    parallel_seed_test(Warehouse, num_cycles=100)
    seed_test(WarehouseTurns, num_cycles=100)


def test_warehouses_pass_the_render_tests() -> None:
    """Every mode that the metadata names gives what it should."""
    render_test(lambda render_mode=None: WarehouseTurns(render_mode=_drawn(render_mode)))
    render_test(
        lambda render_mode=None: parallel_to_aec(Warehouse(render_mode=_drawn(render_mode)))
    )


def _drawn(mode: str | None) -> str | None:
    """PettingZoo's test asks for a window whatever the metadata say."""
    return None if mode == "human" else mode


def test_warehouses_pass_the_state_tests() -> None:
    """The state is in its space."""
    state_test(parallel_to_aec(Warehouse()), Warehouse())
    state_test(WarehouseTurns(), Warehouse())


def test_warehouses_pass_the_max_cycles_test() -> None:
    """As many cycles as the horizon says, in both APIs."""
    max_cycles_test(
        SimpleNamespace(
            env=lambda max_cycles: WarehouseTurns(horizon=max_cycles),
            parallel_env=lambda max_cycles: Warehouse(horizon=max_cycles),
        )
    )


def test_warehouses_are_registered() -> None:
    """Both open by their short names and through PettingZoo's registries."""
    assert isinstance(gk.make("warehouse", orders=3), warehouse.Warehouse)
    assert isinstance(gk.make("warehouse_turns"), warehouse_turns.WarehouseTurns)
    assert "gamekeeper/warehouse-v0" in pettingzoo.parallel_registry
    assert "gamekeeper/warehouse_turns-v0" in pettingzoo.aec_registry


@BOTH
def test_contract_says_what_the_environment_does(kind: type[Any]) -> None:
    """Name, roles, endings, terms, infos, masks, noop and knobs are those of the environment."""
    env = kind(battery=15)
    form = env.declared
    assert form.name == env.metadata["name"]
    assert {a.rpartition("_")[0] for a in env.possible_agents} == set(form.roles)
    assert set(form.knobs) == set(env.knobs.offered)
    _ = kind(**{name: knob.ideal for name, knob in form.knobs.items()})
    terms, endings = set(), set()
    rng = np.random.default_rng(0)
    for seed, policy in ((0, "greedy"), (1, "reference"), (2, "lazy")):
        env = kind(battery=15 if policy == "greedy" else 60)
        env.reset(seed=seed)
        if kind is Warehouse:
            observations, infos = env.reset(seed=seed)
        while env.agents:
            act = kind.policies[policy]
            if kind is Warehouse:
                live = env.agents
                observations, *_, infos = env.step(
                    {a: act(observations[a], a, infos[a], rng) for a in live}
                )
            else:
                seen, _, terminated, truncated, info = env.last()
                ended = terminated or truncated
                env.step(None if ended else act(seen, env.agent_selection, info, rng))
            terms |= {term for paid in env.terms.values() for term in paid}
        endings |= set(env.endings.values())
    assert terms == set(form.rewards)
    assert endings == set(form.endings)


@BOTH
@pytest.mark.parametrize("layout", [*NAMED, "hall"])
@pytest.mark.parametrize("knobs", [{}, EVERY_KNOB], ids=["ideal", "disturbed"])
def test_what_is_shown_lies_in_its_space(kind: type[Any], layout: str, knobs: Any) -> None:
    """Observations, masks, infos and states under random legal actions, with every knob or none."""
    env = kind(layout=layout, battery=20, horizon=40, **knobs)
    rng = np.random.default_rng(3)
    env.reset(seed=3)
    form = env.declared.infos
    while env.agents:
        agents = env.agents if kind is Warehouse else [env.agent_selection]
        actions = {}
        for agent in agents:
            info = env.infos[agent]
            assert env.observation_space(agent).contains(env.observe(agent))
            assert set(info) == set(form)
            assert info["action_mask"].dtype == np.int8
            actions[agent] = int(rng.choice(np.flatnonzero(info["action_mask"])))
        assert env.state_space.contains(env.state())
        if kind is Warehouse:
            env.step(actions)
        else:
            agent = agents[0]
            ended = env.terminations[agent] or env.truncations[agent]
            env.step(None if ended else actions[agent])


@BOTH
@given(
    seed=st.integers(0, 2**32),
    battery=st.integers(3, 30),
    knobs=st.sampled_from([{}, EVERY_KNOB]),
    layout=st.sampled_from(list(NAMED)),
)
@settings(max_examples=8)
def test_laws_of_the_floor_hold_whatever_is_tried(
    kind: type[Any], seed: int, battery: int, knobs: Any, layout: str
) -> None:
    """No order is lost or made, no cell holds two robots, no battery leaves its range."""
    env = kind(layout=layout, battery=battery, spares=2, every=2, horizon=30, **knobs)
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    while env.agents:
        loads = [robot.load for robot in env.robots.values() if robot.load != NOWHERE]
        known = len(env.coming) + int(env.wanted.sum()) + len(loads) + len(env.lying)
        assert known + env.delivered == env.orders
        assert len({env.robots[agent].cell for agent in env.stands.values()}) == len(env.stands)
        there = set(env.stands.values())
        assert {agent for agent in env.agents if agent not in env.endings} <= there
        assert not [agent for agent in there if env.endings.get(agent) == "battery"]
        assert all(env.floor.text[cell] not in CLOSED for cell in env.stands)
        assert all(0 <= robot.battery <= battery for robot in env.robots.values())
        if kind is Warehouse:
            env.step({a: int(rng.integers(6)) for a in env.agents})
        else:
            ended = env.agent_selection in env.endings
            env.step(None if ended else int(rng.integers(6)))


@BOTH
def test_terms_add_up_to_the_reward(kind: type[Any]) -> None:
    """What `terms` keeps apart is all that is paid."""
    env = kind(battery=15)
    rng = np.random.default_rng(5)
    env.reset(seed=5)
    observations: Any = {a: env.observe(a) for a in env.agents}
    while env.agents:
        act = kind.policies["greedy"]
        if kind is Warehouse:
            observations, rewards, *_ = env.step(
                {a: act(observations[a], a, env.infos[a], rng) for a in env.agents}
            )
        else:
            seen, _, terminated, truncated, info = env.last()
            env.step(None if terminated or truncated else act(seen, "", info, rng))
            rewards = env.rewards
        assert rewards == {a: pytest.approx(sum(env.terms.get(a, {}).values())) for a in rewards}


def test_episodes_repeat_bit_for_bit() -> None:
    """The same seed and policy give the same rows in a new instance; another seed others."""
    first = rows_of(Warehouse(**EVERY_KNOB), "reference", 7)
    assert first == rows_of(Warehouse(**EVERY_KNOB), "reference", 7)
    assert first != rows_of(Warehouse(**EVERY_KNOB), "reference", 8)
    assert turns_of(WarehouseTurns(), "greedy", 7) == turns_of(WarehouseTurns(), "greedy", 7)


@pytest.mark.parametrize("knobs", [{}, EVERY_KNOB], ids=["ideal", "disturbed"])
def test_copies_go_on_alike(knobs: Any) -> None:
    """A deep copy, a pickle and a restored snapshot play the same ticks as the original."""
    env = Warehouse(**knobs)
    env.reset(seed=2)
    rng = np.random.default_rng(2)

    def play(env: Warehouse, ticks: int) -> list[Any]:
        rows = []
        for _ in range(ticks):
            actions = {
                a: int(np.flatnonzero(env.infos[a]["action_mask"])[rng.integers(2)])
                for a in env.agents
            }
            rows.append(repr(env.step(actions)))
        return rows

    play(env, 20)
    counterfactuals = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    snapshot, before = env.snapshot(), rng.bit_generator.state
    rows = play(env, 20)
    env.restore(snapshot)
    for counterfactual in (*counterfactuals, env):
        rng.bit_generator.state = before
        assert rows == play(counterfactual, 20)


@BOTH
def test_two_hundred_robots_step(kind: type[Any]) -> None:
    """A hall of a hundred robots of each role plays."""
    ticks = 3 if kind is Warehouse else 1
    env = kind(layout="hall", pickers=100, carriers=100, orders=200, every=1, horizon=ticks)
    env.reset(seed=1)
    assert len(env.agents) == 200
    if kind is Warehouse:
        rows_of(env, "reference", 1)
    else:
        turns_of(env, "reference", 1)
    assert env.ticks == ticks


@pytest.mark.parametrize("seed", range(3))
def test_reference_solves_and_lazy_does_not(seed: int) -> None:
    """A few seeds of what the benchmark measures over many."""
    env = Warehouse()
    rows_of(env, "reference", seed, ticks=200)
    assert set(env.endings.values()) >= {"cleared"}
    rows_of(env, "lazy", seed, ticks=200)
    assert (env.delivered, env.ticks) == (0, 200)


@BOTH
def test_spares_are_shown_nothing(kind: type[Any]) -> None:
    """Who hasn't joined can be asked about, and sees zeros within its space."""
    env = kind()
    env.reset(seed=1)
    shown = env.observe("carrier_2")
    assert env.observation_space("carrier_2").contains(shown)
    assert not shown.any()
    assert env.mask("carrier_2").tolist() == [0, 0, 0, 0, 1, 0]


def test_pictures_show_robots_and_items() -> None:
    """Text has a letter for each robot; a picture is rgb, and a new one every time."""
    env = Warehouse(render_mode="ansi")
    env.reset(seed=1)
    text = env.render()
    assert isinstance(text, str)
    floor = text.split("tick")[0]
    assert (floor.count("p"), floor.count("c")) == (3, 2)
    assert "1" in floor
    env = Warehouse(render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    assert isinstance(first, np.ndarray)
    assert (first.shape, first.dtype) == ((9 * 24, 11 * 24, 3), np.uint8)
    env.step(dict.fromkeys(env.agents, 4))
    assert not np.shares_memory(first, np.asarray(env.render()))
    assert ENERGY < 0
