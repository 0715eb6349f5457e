"""Both warehouses play as the ones written by hand do, number by number."""

from collections.abc import Iterator
from functools import partial
from itertools import count
from typing import Any

import numpy as np
import pytest

from gamekeeper.tasks.warehouse import warehouse, warehouse_turns
from gamekeeper.tasks.warehouse.warehouse_floor import NAMED
from gamekeeper.vector import make
from tests.references.warehouse import Warehouse as WrittenTicks
from tests.references.warehouse_turns import WarehouseTurns as WrittenTurns
from tests.tasks.warehouses import Warehouse, WarehouseTurns
from tests.vector.test_kernel_engine import history, text
from tests.vector.test_vector import same as equal

PAIRS = (
    (partial(Warehouse, debug=True), WrittenTicks),
    (partial(WarehouseTurns, debug=True), WrittenTurns),
)
COMPILED = ((warehouse.Warehouse, WrittenTicks), (warehouse_turns.WarehouseTurns, WrittenTurns))
SIZES: tuple[dict[str, Any], ...] = (
    {},
    {"battery": 15, "spares": 2, "orders": 12, "every": 1},
    {"layout": "ring", "pickers": 6, "carriers": 6, "every": 2, "horizon": 60},
    {"layout": "wide", "pickers": 8, "carriers": 5, "spares": 0, "orders": 30, "every": 1},
    {"layout": "hall", "pickers": 20, "carriers": 20, "orders": 90, "every": 1, "battery": 25},
    {"layout": ("s.h", "..d", "c.."), "pickers": 1, "carriers": 1, "spares": 3, "battery": 9},
)
HARD: dict[str, Any] = {
    "observation_noise": 1.5,
    "occlusion": 0.3,
    "observation_delay": {"picker": 2},
    "odometry_drift": 0.4,
    "actuator_slip": 0.2,
    "actuator_dropout": 0.1,
    "latency": {"picker_1": 1},
    "slowness": {"carrier_0": 1},
    "held_out": 0.5,
}
SIZE_IDS = ("small", "dying", "ring", "wide", "hall", "tiny")


def same(mine: Any, its: Any) -> bool:
    """Equal in type, dtype and every number; dictionaries in their order too."""
    if isinstance(its, dict):
        return list(mine) == list(its) and all(same(mine[key], its[key]) for key in its)
    if isinstance(its, np.ndarray):
        return mine.dtype == its.dtype and np.array_equal(mine, its)
    if isinstance(its, tuple):
        return all(map(same, mine, its))
    return type(mine) is type(its) and mine == its


def chosen(env: Any, agent: str, seen: Any, info: Any, rng: np.random.Generator) -> int:
    """Tries of all kinds, greedy and careful moves, in turn."""
    mood = rng.random()
    if mood < 0.2:
        return int(rng.integers(6))
    policy = env.policies["greedy" if mood < 0.5 else "reference"]
    return int(policy(seen, agent, info, rng))


def env_steps(env: Any, its: Any, rng: np.random.Generator) -> Iterator[tuple[Any, Any, int]]:
    """Episodes of both under the same actions: what each gave, and how many acted."""
    for seed in count():
        given = [each.reset(seed=seed) for each in (env, its)]
        while env.agents:
            if hasattr(env, "agent_selection"):
                given = [(each.agent_selection, each.last(), each.rewards) for each in (env, its)]
                yield *given, 1
                agent, (seen, _, terminated, truncated, info), _ = given[0]
                ended = terminated or truncated
                action = None if ended else chosen(env, agent, seen, info, rng)
                for each in (env, its):
                    each.step(action)
            else:
                yield *given, len(env.agents)
                seen, infos = given[0][0], given[0][-1]
                actions = {a: chosen(env, a, seen[a], infos[a], rng) for a in env.agents}
                given = [each.step(actions) for each in (env, its)]
        if not hasattr(env, "agent_selection"):
            yield *given, 0


def compare(env: Any, its: Any, steps: int) -> None:
    """Plays so many steps of an agent each; after each, all that can be asked is the same."""
    played, rng = 0, np.random.default_rng(7)
    for mine, theirs, acted in env_steps(env, its, rng):
        assert same(mine, theirs), (mine, theirs)
        assert env.agents == its.agents
        assert same(env.state(), its.state())
        assert env.terms == its.terms
        assert env.endings == its.endings
        assert env.rng.state == its.rng.state
        played += acted
        if played >= steps:
            return


@pytest.mark.parametrize("pair", PAIRS, ids=("ticks", "turns"))
@pytest.mark.parametrize("given", SIZES, ids=SIZE_IDS)
def test_warehouse_equals_the_one_written_by_hand(pair: Any, given: dict[str, Any]) -> None:
    """Observations, rewards by term, endings, infos, masks, states and draws, as plain Python."""
    compare(*(kind(**given) for kind in pair), steps=400)


@pytest.mark.parametrize("pair", PAIRS, ids=("ticks", "turns"))
def test_warehouse_equals_it_under_every_knob(pair: Any) -> None:
    """Drift, delays, slips and held-out floors come to the same."""
    compare(*(kind(**HARD) for kind in pair), steps=600)


@pytest.mark.parametrize("pair", COMPILED, ids=("ticks", "turns"))
def test_warehouse_compiled_equals_the_one_written_by_hand(pair: Any) -> None:
    """The same, compiled, over 2,000 steps."""
    compare(*(kind() for kind in pair), steps=2_000)


@pytest.mark.parametrize("pair", COMPILED, ids=("ticks", "turns"))
@pytest.mark.parametrize("given", [SIZES[1], SIZES[4]], ids=["dying", "hall"])
def test_warehouse_compiled_equals_it_in_other_sizes(pair: Any, given: dict[str, Any]) -> None:
    """Robots that end and join, and the largest hall; plain Python is compared in every size."""
    compare(*(kind(**given) for kind in pair), steps=500)


@pytest.mark.parametrize("pair", PAIRS, ids=("ticks", "turns"))
def test_warehouse_is_drawn_as_the_one_written_by_hand(pair: Any) -> None:
    """Text and pictures are the same after some steps."""
    for mode in ("ansi", "rgb_array"):
        env, its = (kind(render_mode=mode) for kind in pair)
        for turn, _ in enumerate(env_steps(env, its, np.random.default_rng(2))):
            if turn % 10 == 0:
                assert np.array_equal(env.render(), its.render())
            if turn == 40:
                break


@pytest.mark.parametrize("spec", ["warehouse", "warehouse_turns"])
def test_warehouse_batches_give_what_serial_gives(spec: str) -> None:
    """Robots that end and join, last observations, infos: of a batch as of copies one by one."""
    kwargs = {"debug": True, "battery": 10, "horizon": 9, "pickers": 2, "carriers": 2}
    options: dict[str, Any] = {"infos": True, "env_kwargs": kwargs}
    with make(spec, 2, **options) as serial, make(spec, 2, engine="kernel", **options) as kernel:
        finals = 0
        for one, two in zip(history(serial, 40), history(kernel, 40), strict=True):
            assert one[-1].keys() == two[-1].keys()
            assert all(text(value) == text(two[-1][key]) for key, value in one[-1].items())
            assert all(map(equal, one[:-1], two[:-1]))
            finals += "final_obs" in one[-1]
        assert finals


@pytest.mark.parametrize("layout", NAMED)
def test_layouts_of_one_size_share_their_code(layout: str) -> None:
    """A held-out floor has tables of the same dtype as the one that it was shuffled from."""
    env = Warehouse(layout=layout, held_out=1.0)
    env.reset(seed=1)
    assert env.floor != env.layout
    assert env.kernel.tables.dtype == env.tables.dtype
    assert env.not_batched == "knobs"
    assert Warehouse(layout=layout).not_batched == ""
