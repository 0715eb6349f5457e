"""Vector environments: every engine gives what a plain loop over the copies gives."""

import pickle
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import ActionError, EnvError, OrderError, SpecError
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.vector import make
from gamekeeper.vector.final_rows import FinalRows
from tests.vector import worlds

HERE = worlds.__file__
PARALLEL = ("two_robot_line", "warehouse", f"{HERE}:Camp", f"{HERE}:Walk", "handover")
AEC = ("warehouse_turns", "aec:two_robot_line", f"aec:{HERE}:Walk", "classic/tictactoe-v3")
ENVS = 5
STEPS = 60


def arrays(value: Any) -> list[Any]:
    """The arrays in a tree of dictionaries and tuples, in a settled order."""
    if isinstance(value, dict):
        return [array for key in sorted(value, key=str) for array in arrays(value[key])]
    if isinstance(value, tuple | list):
        return [array for part in value for array in arrays(part)]
    return [value]


def same(one: Any, two: Any) -> bool:
    """Whether two trees hold equal arrays of equal dtypes, or equal objects."""
    ones, twos = (
        [np.asarray(part) if isinstance(part, FinalRows) else part for part in arrays(tree)]
        for tree in (one, two)
    )
    return len(ones) == len(twos) and all(
        np.array_equal(a, b) and getattr(a, "dtype", None) == getattr(b, "dtype", None)
        if isinstance(a, np.ndarray) and a.dtype != object
        else _objects(a, b)
        for a, b in zip(ones, twos, strict=True)
    )


def _objects(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        pairs = zip(a, b, strict=True)
        return all((x is None) == (y is None) and (x is None or same(x, y)) for x, y in pairs)
    return type(a) is type(b) and bool(a == b)


def legal(infos: dict[str, Any], actions: Any, step: int) -> Any:
    """Actions that masks allow, from a fixed stream."""
    if isinstance(actions, dict):
        masks = infos.get("action_mask", {})
        return {k: _legal(masks.get(k), actions[k], step) for k in actions}
    return _legal(infos.get("action_mask"), actions, step)


def _legal(mask: Any, actions: Any, step: int) -> Any:
    if mask is None:
        return actions
    if mask.shape[:-1] != actions.shape:  # parts of a MultiDiscrete: 0 is always legal here
        return actions * 0
    scores = np.random.default_rng(step).random(mask.shape) * (mask > 0)
    return np.where(mask.any(-1), scores.argmax(-1), actions)


def history(venv: Any, steps: int = STEPS) -> list[Any]:
    """All that a vector environment says, step by step."""
    venv.action_space.seed(3)
    found = [venv.reset(seed=11)]
    for step in range(steps):
        sampled = venv.action_space.sample()
        found.append(venv.step(legal(found[-1][-1], sampled, step)))
    return found


@pytest.mark.parametrize("autoreset", ["same_step", "next_step"])
@pytest.mark.parametrize("spec", ["two_robot_line", f"{HERE}:Walk"])
def test_serial_equals_a_plain_loop(spec: str, autoreset: str) -> None:
    """Rows of arrays are what each copy gives when it is stepped alone."""
    with make(spec, ENVS, autoreset=autoreset) as venv:
        said = history(venv)
        venv.action_space.seed(3)
        actions = [venv.action_space.sample() for _ in range(STEPS)]
        for e in range(ENVS):
            check_copy(spec, e, actions, said, autoreset)


def check_copy(spec: str, e: int, actions: list[Any], said: list[Any], autoreset: str) -> None:
    """Plays the episodes of slot `e` alone and compares."""
    env = gk.make(spec)
    names, episode, is_over = list(env.possible_agents), e, False
    observations, _ = env.reset(seed=episode_seed(11, episode))
    for step, action in enumerate(actions):
        obs, rewards, terminated, truncated, infos = (part for part in said[step + 1])
        if is_over:  # next_step
            observations, _ = env.reset(seed=episode_seed(11, episode))
            is_over = False
            assert not rewards[e].any()
        else:
            live = list(env.agents)
            out = env.step({a: action[e, names.index(a)] for a in live})
            observations = out[0]
            for place, agent in enumerate(names):
                assert rewards[e, place] == out[1].get(agent, 0.0)
                assert terminated[e, place] == out[2].get(agent, False)
                assert truncated[e, place] == out[3].get(agent, False)
            if not env.agents:
                episode, is_over = episode + ENVS, True
                final = infos["final_obs"][e]
                assert all(np.array_equal(final[names.index(a)], observations[a]) for a in live)
                assert infos["final_info"][e].keys() == out[4].keys()
                if autoreset == "same_step":
                    observations, _ = env.reset(seed=episode_seed(11, episode))
                    is_over = False
        for place, agent in enumerate(names):
            expected = observations.get(agent, np.zeros_like(obs[e, place]))
            assert np.array_equal(obs[e, place], expected)
            assert infos["live"][e, place] == (agent in env.agents)


@pytest.mark.parametrize("autoreset", ["same_step", "next_step"])
@pytest.mark.parametrize("spec", AEC)
def test_turn_batches_equal_a_plain_loop(spec: str, autoreset: str) -> None:
    """Each step is one turn of the agent in turn; rewards reach whom the rules paid."""
    with make(spec, ENVS, autoreset=autoreset) as venv:
        said = history(venv)
        if isinstance(venv.agents, dict):
            pytest.skip("the plain loop of this test reads one group")
        for e in range(ENVS):
            totals = check_turns(spec, e, venv, said, autoreset)
            assert np.array_equal(totals, sum(each[1][e] for each in said[1:]))


def check_turns(spec: str, e: int, venv: Any, said: list[Any], autoreset: str) -> Any:
    """Plays slot `e` alone with the actions that the vector environment was given."""
    env = gk.make(spec)
    names, episode, is_over = list(env.possible_agents), e, False
    totals = np.zeros(len(names))
    env.reset(seed=episode_seed(11, episode))
    venv.action_space.seed(3)
    for step in range(STEPS):
        action = legal(said[step][-1], venv.action_space.sample(), step)[e]
        if is_over:
            env.reset(seed=episode_seed(11, episode))
            is_over = False
        else:
            env.step(action)
            totals += [env.rewards.get(agent, 0.0) for agent in names]
            while env.agents and (
                env.terminations[env.agent_selection] or env.truncations[env.agent_selection]
            ):
                env.last()
                env.step(None)
            if not env.agents:
                episode, is_over = episode + ENVS, True
                assert said[step + 1][-1]["_final_obs"][e]
                if autoreset == "same_step":
                    env.reset(seed=episode_seed(11, episode))
                    is_over = False
        if not is_over:
            observation = env.last()[0]
            mine = said[step + 1][0]
            mine = {k: v[e] for k, v in mine.items()} if isinstance(mine, dict) else mine[e]
            assert same(mine, observation)
            assert names[said[step + 1][-1]["turn"][e]] == env.agent_selection
    return totals


@pytest.mark.parametrize(
    ("spec", "autoreset", "workers"),
    [
        (f"{HERE}:Camp", "same_step", 3),
        (f"{HERE}:Late", "next_step", 2),
        ("warehouse_turns", "same_step", 2),
        (f"{HERE}:LateTurns", "next_step", 1),
    ],
)
def test_process_equals_serial(spec: str, autoreset: str, workers: int) -> None:
    """Nothing depends on the engine or on the number of workers."""
    with make(spec, ENVS, autoreset=autoreset, infos=True) as venv:
        here = history(venv)
    options = {"engine": "process", "workers": workers, "autoreset": autoreset, "infos": True}
    with make(spec, ENVS, **options) as venv:
        there = history(venv)
    for one, two in zip(here, there, strict=True):
        assert same(one, two)


def test_groups_by_role_where_spaces_differ() -> None:
    """Agents with other spaces stand in dictionaries by role, masks with them."""
    with make(f"{HERE}:Camp", 2) as venv:
        obs, infos = venv.reset()

    assert venv.agents == {"scout": ["scout_0", "scout_1"], "cook": ["cook"]}
    assert obs["scout"]["at"].shape == (2, 2, 2)
    assert obs["cook"].shape == (2, 1, 3)
    assert infos["action_mask"]["scout"].shape == (2, 2, 3)
    assert infos["action_mask"]["cook"].tolist() == [[[1, 1, 1, 0, 1]]] * 2
    assert infos["live"]["scout"].all()


def test_dead_agents_hold_zeros() -> None:
    """Where `live` is False there is nothing to learn from."""
    with make(f"{HERE}:Walk", 8) as venv:
        venv.reset(seed=1)
        dead = 0
        for _ in range(30):
            obs, rewards, terminated, truncated, infos = venv.step(venv.action_space.sample())
            quiet = ~infos["live"] & ~(terminated | truncated)
            dead += quiet.sum()
            assert not obs[quiet].any()
            assert not rewards[quiet].any()
    assert dead > 0


def test_reset_begins_the_same_run_again() -> None:
    """A seed names a run; without one it is the seed that the copies were made with."""
    with make("warehouse", 3, seed=5) as venv:
        first, _ = venv.reset()
        venv.step(venv.action_space.sample())
        again, _ = venv.reset(seed=5)
        other, _ = venv.reset(seed=6)

    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"engine": "gpu"}, "engine"),
        ({"autoreset": "never"}, "autoreset"),
        ({"num_envs": 0}, "num_envs"),
        ({"workers": 0}, "workers"),
        ({"on_failure": "hope"}, "on_failure"),
    ],
)
def test_make_refuses_options_it_does_not_know(options: dict[str, Any], named: str) -> None:
    """The option is named."""
    with pytest.raises(SpecError, match=named):
        make(**{"spec": "two_robot_line", "num_envs": 2, **options})


def test_make_refuses_one_object_and_what_no_process_can_build() -> None:
    """One environment can't be many, and a factory in memory can't cross."""
    with pytest.raises(SpecError, match="can't be many"):
        make(worlds.Walk(), 2)
    with pytest.raises(SpecError, match="another process"):
        make(worlds.Walk, 2, engine="process")


def test_actions_that_do_not_fit_are_refused() -> None:
    """Shape and roles are checked before anything moves."""
    with make(f"{HERE}:Camp", 2) as venv:
        with pytest.raises(OrderError, match="reset"):
            venv.step({})
        venv.reset()
        with pytest.raises(ActionError, match="every role"):
            venv.step({"scout": np.zeros((2, 2), np.int64)})
        with pytest.raises(ActionError, match="don't fit"):
            venv.step({"scout": np.zeros(3), "cook": np.zeros((2, 1, 2), np.int64)})
    with pytest.raises(OrderError, match="closed"):
        venv.reset()


@pytest.mark.parametrize("engine", ["serial", "process"])
def test_what_raises_is_named(engine: str) -> None:
    """The copy, the error and its traceback."""
    with make(f"{HERE}:Raises", 4, engine=engine) as venv, pytest.raises(EnvError) as caught:
        history(venv, 4)

    assert "env 0" in caught.value.where
    assert "the bridge is out" in str(caught.value)
    assert "in tick" in caught.value.actual


@pytest.mark.parametrize(("kind", "how"), [("Dies", "signal 9"), ("Hangs", "no sign of life")])
def test_worker_that_dies_or_hangs_is_named(kind: str, how: str) -> None:
    """A process that is gone says which copy it was stepping."""
    with (
        make(f"{HERE}:{kind}", 4, engine="process", timeout_s=1.0) as venv,
        pytest.raises(EnvError) as caught,
    ):
        history(venv, 4)

    assert how in str(caught.value)
    assert "envs 0 to 1" in caught.value.where


def test_last_observations_behave_as_an_array_of_objects() -> None:
    """Indices, masks, attributes, operators, NumPy's functions: as Gymnasium's array has them."""
    with gk.vector.make("spread", 4, env_kwargs={"max_cycles": 2}) as venv:
        venv.reset()
        for _ in range(2):
            *_, infos = venv.step(np.zeros(venv.action_space.shape, np.int64))
        finals, is_final = infos["final_obs"], infos["_final_obs"]
        assert (finals.shape, finals.dtype, finals.ndim, len(finals)) == ((4,), object, 1, 4)
        plain = np.asarray(finals)
        assert np.stack(finals[is_final]).shape == (4, 3, 18)
        assert (infos["final_info"] != None).tolist() == [True] * 4  # noqa: E711  # element by element
        assert np.stack(list(finals)[1:3]).tolist() == np.stack(finals[1:3]).tolist()
        finals[0] = None
        assert finals[0] is finals.copy()[0] is None
        assert pickle.loads(pickle.dumps(finals))[1].tolist() == plain[1].tolist()


@pytest.mark.parametrize("engine", ["serial", "process"])
def test_last_observation_comes_with_the_end(engine: str) -> None:
    """An agent that ends in an AEC copy that goes on without it is told so at once."""
    with make(f"{HERE}:Leaves", 2, engine=engine) as venv:
        venv.reset(seed=0)
        told = []
        for step in range(1, 16):
            *_, terminated, truncated, infos = venv.step(np.ones(2, int))
            ended = (terminated | truncated)[0].nonzero()[0].tolist()
            assert bool(ended) == bool(infos.get("_final_obs", [False])[0])
            told += [(step, infos["final_obs"][0][place].tolist()) for place in ended]
            assert infos["over"].tolist() == [step == 14] * 2
    assert told == [(7, [7.0, 0.0]), (9, [9.0, 1.0]), (14, [14.0, 2.0])]
