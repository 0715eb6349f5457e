"""What the four worlds of particles have in common: physics, pictures, contracts, policies."""

import functools
import math
import pickle
from collections.abc import Sequence
from typing import Any

import numpy as np
import pettingzoo
import pytest
from gymnasium.spaces import Box
from hypothesis import given
from hypothesis import strategies as st
from pettingzoo.test import parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils.conversions import parallel_to_aec

import gamekeeper.tasks  # noqa: F401  # registers the tasks
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.errors import ActionError, SpecError
from gamekeeper.interface.contract_draft import agent_specs, draft_contract
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.scalar_rules import as_python, numba
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.particles import physics as p
from gamekeeper.tasks.particles.particle_env import SIDE, spoken
from gamekeeper.vector import make
from tests.tasks.particle_worlds import PAIRS

KERNELS = {name: pair[0] for name, pair in PAIRS.items()}


def made(name: str, **arguments: Any) -> Any:
    """A world in plain Python."""
    return KERNELS[name](debug=True, **arguments)


def played(env: Any, seed: int, policy: str) -> tuple[float, dict[str, Any]]:
    """The mean return of all agents in one episode, and the last infos."""
    seen, infos = env.reset(seed=seed)
    total, rng = 0.0, np.random.default_rng(seed)
    act = env.policies[policy]
    while env.agents:
        actions = {a: act(seen[a], a, infos[a], rng) for a in env.agents}
        seen, rewards, _, _, infos = env.step(actions)
        total += sum(rewards.values())
    return total / len(env.possible_agents), infos


@pytest.mark.parametrize("name", PAIRS)
def test_world_conforms_to_pettingzoo(name: str) -> None:
    """PettingZoo's own tests pass on the registered task, and nothing warns."""
    make = functools.partial(pettingzoo.make, "parallel", f"gamekeeper/{name}-v0", debug=True)
    parallel_api_test(make(), num_cycles=60)
    parallel_seed_test(make, num_cycles=30)


@pytest.mark.parametrize("is_continuous", [False, True])
@pytest.mark.parametrize("name", PAIRS)
def test_contract_fits_and_leaves_nothing_open(name: str, is_continuous: bool) -> None:
    """The contract declares what the draft sees, answers every question, and fits the arguments."""
    env = made(name, continuous_actions=is_continuous, max_cycles=7)
    drafted, declared = draft_contract(env), env.declared
    assert (declared.name, declared.api) == (drafted.name, drafted.api)
    assert declared.schedule.horizon == 7
    specs = agent_specs(env, declared)
    assert open_questions(declared, specs) == ()
    for spec in specs:
        noop = declared.roles[spec.role].noop
        assert noop == "none" or env.action_space(spec.name).contains(
            np.array(noop, env.action_space(spec.name).dtype)
        )


@pytest.mark.parametrize("name", PAIRS)
def test_world_renders(name: str) -> None:
    """As text agents and landmarks stand in lines, as an array in a square picture."""
    env = made(name, render_mode="ansi")
    env.reset(seed=1)
    env.step(dict.fromkeys(env.agents, 1))
    text = env.render()
    assert set("".join(text.splitlines()[:21])) <= set(".oASL")
    assert "o" in text
    assert ("says B" in text) == (name == "speaker_listener")
    assert ("says A" in text) == (name == "reference")
    for rescales in (True, False):
        env = made(name, render_mode="rgb_array", dynamic_rescaling=rescales)
        env.reset(seed=1)
        assert env.render().shape == (SIDE, SIDE, 3)
        assert len(np.unique(env.render().reshape(-1, 3), axis=0)) > 3
    env = made(name)
    env.reset(seed=1)
    assert env.render() is None


def test_rendering_conforms_to_pettingzoo() -> None:
    """PettingZoo's own test of pictures passes."""
    render_test(lambda **mode: parallel_to_aec(made("reference", **mode)), {})


@pytest.mark.parametrize(
    ("name", "solo", "team"),
    [
        ("spread", "lazy", "greedy"),
        ("spread", "greedy", "reference"),
        ("reference", "greedy", "reference"),
        ("speaker_listener", "greedy", "reference"),
        ("speaker_listener", "lazy", "reference"),
    ],
)
def test_policies_do_what_they_say(name: str, solo: str, team: str) -> None:
    """Over twenty episodes who plays together is paid more than who doesn't."""
    env = made(name, max_cycles=40)
    returns = {
        policy: np.mean([played(env, seed, policy)[0] for seed in range(20)])
        for policy in (solo, team)
    }
    assert returns[team] > returns[solo]


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("spread", {"N": 0}),
        ("spread", {"N": True}),
        ("spread", {"local_ratio": 1.5}),
        ("spread", {"max_cycles": 0}),
        ("spread", {"num_agent_neighbors": 0}),
        ("spread", {"curriculum_stage": 2}),
        ("tag", {"num_good": 0}),
        ("tag", {"num_adversaries": -1}),
        ("tag", {"num_obstacles": 1.0}),
        ("tag", {"num_landmark_neighbors": 0}),
        ("reference", {"local_ratio": "half"}),
        ("speaker_listener", {"max_cycles": 2.5}),
    ],
)
def test_world_refuses_what_it_can_not_be(name: str, arguments: dict[str, Any]) -> None:
    """An argument out of its range is named."""
    (argument,) = arguments
    with pytest.raises(SpecError, match=f"where: {argument}"):
        made(name, **arguments)


@pytest.mark.parametrize("name", PAIRS)
def test_world_refuses_actions_outside_its_space(name: str) -> None:
    """An amount above 1 and a move too many are errors, and nothing moves."""
    for is_continuous in (True, False):
        env = made(name, continuous_actions=is_continuous)
        env.reset(seed=0)
        before = env.state()
        spaces = {a: env.action_space(a) for a in env.agents}
        too_much = {
            a: np.full(s.shape, 1.5, np.float32) if isinstance(s, Box) else s.n
            for a, s in spaces.items()
        }
        with pytest.raises(ActionError):
            env.step(too_much)
        assert np.array_equal(before, env.state())


@pytest.mark.parametrize("name", PAIRS)
def test_world_is_what_its_seed_says(name: str) -> None:
    """One seed, one beginning; a snapshot and a pickle go on as the world itself does."""
    first, second = made(name), made(name)
    for seed in (4, 2**63 + 5):
        one, two = first.reset(seed=seed)[0], second.reset(seed=seed)[0]
        assert all(np.array_equal(one[a], two[a]) for a in one)
    kept, pickled = first.snapshot(), pickle.loads(pickle.dumps(second.snapshot()))
    after = [env.step(dict.fromkeys(env.agents, 2))[0] for env in (first, second)]
    for env, snapshot in ((first, kept), (second, pickled)):
        env.restore(snapshot)
        after.append(env.step(dict.fromkeys(env.agents, 2))[0])
    assert all(np.array_equal(after[0][a], other[a]) for other in after for a in other)


def test_places_are_drawn_as_mpe2_draws_them() -> None:
    """Agent by agent, then landmark by landmark, x before y, in the bounds of the task."""
    for name, bound, goals in (("spread", 1.0, 0), ("tag", 0.9, 0), ("reference", 1.0, 2)):
        env, stream = made(name), Stream(9)
        env.reset(seed=9)
        s = env.memory.records[0]
        if goals:
            assert [stream.integers(3) for _ in range(goals)] == s["goal"].tolist()
        agents = [stream.uniform(-1.0, 1.0) for _ in range(2 * len(s["x"]))]
        assert agents == np.stack([s["x"], s["y"]], 1).ravel().tolist()
        marks = [stream.uniform(-bound, bound) for _ in range(2 * len(s["mark_x"]))]
        assert marks == np.stack([s["mark_x"], s["mark_y"]], 1).ravel().tolist()


@given(st.floats(-2.0, p.CLOSE))
def test_contact_is_softened_as_mpe2_softens_it(gap: float) -> None:
    """P3: to the last digit."""
    for z in (gap, 0.001 * gap, 0.0):
        expected = np.logaddexp(0, -z / p.MARGIN) * p.MARGIN
        assert expected == as_python(p.penetration)(z)


def test_bodies_that_are_apart_do_not_push() -> None:
    """P3: beyond CLOSE there is no force, and there would be next to none."""
    push = as_python(p.repulsion)
    assert push(0.3 + p.CLOSE + 1e-9, 0.0, 0.3) == (0.0, 0.0)
    fx, fy = push(0.3 + p.CLOSE - 1e-9, 0.0, 0.3)
    assert 0.0 < fx < 4e-18
    assert fy == 0.0


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.05, 0.5))
def test_bodies_push_each_other_apart(dx: float, dy: float, reach: float) -> None:
    """P3: along the line between them, and alike; from the very same point not at all."""
    push = as_python(p.repulsion)
    fx, fy = push(dx, dy, reach)
    assert (-fx, -fy) == push(-dx, -dy, reach)
    assert math.copysign(1.0, fx * dx) == 1.0 or fx == 0.0
    assert math.isclose(fx * dy, fy * dx, abs_tol=1e-9)
    assert push(0.0, 0.0, reach) == (0.0, 0.0)


def test_words_are_shown_as_letters_or_numbers() -> None:
    """A line for nothing, a letter for a word, numbers for a continuous one."""
    said = [np.zeros(3), np.eye(3)[2], np.array([0.25, 0.5, 0.0])]
    assert [spoken(word) for word in said] == ["_", "C", "0.25 0.50 0.00"]


@pytest.mark.skipif(numba() is None, reason="Numba, the extra `fast`, isn't installed")
@pytest.mark.parametrize("name", ["spread", "tag", "speaker_listener"])
def test_compiled_batch_gives_the_bits_of_the_plain_one(name: str) -> None:
    """Every observation, reward and byte of state, over episodes; an array for each group."""
    kernel = made(name).kernel
    plain, compiled = (Batch(kernel, 3, seed=5, debug=d) for d in (True, False))
    rng = np.random.default_rng(0)
    for batch in (plain, compiled):
        batch.reset()
    for _ in range(60):
        parts = [rng.integers(0, g.action_space.n, (3, g.count)) for g in kernel.groups]
        for batch in (plain, compiled):
            batch.step(parts[0] if len(parts) == 1 else parts)
        assert plain.snapshot() == compiled.snapshot()
        for field in ("obs", "rewards", "terms", "truncated", "live"):
            one, two = getattr(plain.arrays, field), getattr(compiled.arrays, field)
            pairs = zip(one, two, strict=True) if isinstance(one, tuple) else [(one, two)]
            assert all(np.array_equal(a, b) for a, b in pairs), field
    assert plain.records["number"].min() >= 3


@pytest.mark.parametrize("name", ["tag", "speaker_listener"])
def test_vector_engines_agree_where_roles_differ(name: str) -> None:
    """The kernel engine gives what the serial one gives, a group of arrays for each role."""
    options: dict[str, Any] = {"seed": 2, "infos": True, "env_kwargs": {"debug": True}}
    told = []
    for engine in ("serial", "kernel"):
        with make(name, 3, engine=engine, **options) as venv:
            venv.action_space.seed(1)
            given = [venv.reset()]
            given += [venv.step(venv.action_space.sample()) for _ in range(30)]
            told.append([[plain(part) for part in step] for step in given])
    assert told[0] == told[1]


def plain(value: Any) -> Any:
    """Arrays as lists, whatever they stand in."""
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if hasattr(value, "tolist"):  # also last observations, which are made as they are read
        return plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(part) for part in value]
    return value
