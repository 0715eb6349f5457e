"""pursuit: compiled and plain, thousands of agents, arguments, policies, pictures."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gamekeeper.errors import SpecError
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.scalar_rules import numba
from gamekeeper.tasks.pursuit.pursuit import (
    METADATA,
    Pursuit,
    greedy,
    lazy,
    pursuit_kernel,
    reference,
)
from tests.tasks.pursuit_fields import field

SMALL: dict[str, Any] = {
    "pursuers": 4,
    "evaders": 3,
    "rows": 6,
    "columns": 7,
    "pursuer_sight": 2,
    "evader_sight": 1,
}


@pytest.mark.skipif(numba() is None, reason="Numba, the extra `fast`, isn't installed")
@pytest.mark.parametrize("script", ["agents", "flee"])
def test_pursuit_compiled_equals_plain(script: str) -> None:
    """Bit for bit: state, observations, rewards and ends of a batch, across episodes."""
    kernel = pursuit_kernel(**SMALL, stamina=20, horizon=40, evaders_are=script)
    batches = [Batch(kernel, 3, seed=5, debug=debug) for debug in (True, False)]
    for batch in batches:
        batch.reset()
    rng = np.random.default_rng(0)
    for _ in range(120):
        moves = rng.integers(0, 5, (3, 7))
        for batch in batches:
            if script == "agents":
                batch.arrays.actions[0][:], batch.arrays.actions[1][:] = moves[:, :4], moves[:, 4:]
            else:
                batch.arrays.actions[:] = moves[:, :4]
            batch.step()
        one, two = batches
        assert one.snapshot() == two.snapshot()
        for name in ("obs", "rewards", "terminated", "truncated", "live", "final", "last"):
            pairs = _parts(getattr(one.arrays, name)), _parts(getattr(two.arrays, name))
            assert all(np.array_equal(a, b) for a, b in zip(*pairs, strict=True)), name


def _parts(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def lines_of(play: Callable[[], object]) -> int:
    """How many lines of the package run in a call."""
    count = 0

    def episode(frame: Any, event: str, argument: object) -> Any:
        nonlocal count
        if "gamekeeper" not in frame.f_code.co_filename:
            return None
        count += event == "line"
        return episode

    sys.settrace(episode)
    try:
        play()
    finally:
        sys.settrace(None)
    return count


def test_pursuit_costs_the_same_for_each_of_many() -> None:
    """Nothing grows with the square of the agents: as many lines for each of 800 as of 100."""
    cost = {}
    for side in (20, 40, 80):
        half = side * side // 16
        env = Pursuit(
            pursuers=half,
            evaders=half,
            rows=side,
            columns=side,
            debug=True,
            pursuer_sight=1,
            evader_sight=1,
        )
        env.reset(seed=0)
        rng = np.random.default_rng(0)
        actions = {agent: int(rng.integers(5)) for agent in env.agents}
        cost[2 * half] = lines_of(lambda env=env, actions=actions: env.step(actions)) / (2 * half)
    assert cost[800] < 1.05 * cost[200] < 1.1 * cost[50]


def test_pursuit_plays_with_two_thousand() -> None:
    """A thousand of each, some of whom die and leave."""
    env = Pursuit(
        pursuers=1000,
        evaders=1000,
        rows=120,
        columns=120,
        stamina=5,
        debug=True,
        pursuer_sight=1,
        evader_sight=1,
    )
    env.reset(seed=0)
    rng, left = np.random.default_rng(0), [2000]
    for _ in range(7):
        moves = rng.integers(0, 5, len(env.agents)).tolist()
        env.step(dict(zip(env.agents, moves, strict=True)))
        left.append(len(env.agents))
    assert left[0] > left[2] > left[5] > left[7] > 0
    assert {"caught", "starved"} <= set(env.endings.values())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("pursuers", 0),
        ("evaders", 2.0),
        ("catchers", 5),
        ("stamina", -1),
        ("rocks", 1.5),
        ("evaders_are", "fast"),
        ("rows", 1),
        ("pursuer_sight", 0),
    ],
)
def test_pursuit_refuses_numbers_out_of_range(name: str, value: Any) -> None:
    """The argument is named, with what it may be."""
    with pytest.raises(SpecError) as refused:
        Pursuit(**{name: value})
    assert name in str(refused.value)


def test_pursuit_policies_hunt_flee_and_wait() -> None:
    """Who hunts catches most evaders that stay; pursuers that stay starve."""
    left = {}
    for hunters in (reference, greedy, lazy):
        env, left[hunters] = Pursuit(rows=10, columns=10, stamina=50, debug=True), 0
        for seed in range(2):
            rng = np.random.default_rng(seed)
            seen, infos = env.reset(seed=seed)
            while env.agents:
                policies = {"p": hunters, "e": lazy}
                actions = {a: policies[a[0]](seen[a], a, infos[a], rng) for a in env.agents}
                seen, *_, infos = env.step(actions)
            left[hunters] += next(iter(infos.values()))["evaders"]
    assert max(left[reference], left[greedy]) < left[lazy] / 3
    seen, infos = env.reset(seed=0)
    rng = np.random.default_rng(0)
    assert {reference(seen[a], a, infos[a], rng) for a in env.agents} <= set(range(5))


def test_pursuit_draws_its_field() -> None:
    """Cells of 24 pixels, smaller where there are many; nothing without a mode."""
    env = Pursuit(render_mode="rgb_array", debug=True)
    env.reset(seed=0)
    assert env.render().shape == (384, 384, 3)
    large = Pursuit(render_mode="rgb_array", rows=200, columns=100, debug=True)
    large.reset(seed=0)
    assert large.render().shape == (800, 400, 3)
    env = field("P#e", "...")
    assert env.render().splitlines()[0][:3] == "P#e"
    assert env.render().splitlines()[-1] == "1 evaders left"


def test_pursuit_contract_stands_beside_it() -> None:
    """Its name, API and roles are the environment's."""
    declared = Pursuit(debug=True).declared
    assert (declared.name, declared.api) == (METADATA["name"], "parallel")
    assert list(declared.roles) == ["pursuer", "evader"]
