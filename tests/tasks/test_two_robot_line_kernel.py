"""The kernel of `two_robot_line` plays as the rules written by hand."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.compile_cache import kernel_key
from gamekeeper.randomness.seeds import EpisodeSeeds
from gamekeeper.tasks.two_robot_line import HORIZON, KNOBS, TwoRobotLine, two_robot_line_kernel
from tests.references.two_robot_line import TwoRobotLine as Reference
from tests.tasks.alike import ticks_alike, uniform

HARD: dict[str, Any] = dict.fromkeys(KNOBS, 0.4) | {
    "observation_delay": 2,
    "latency": 1,
    "slowness": {"carrier": 1},
}


@pytest.mark.parametrize("debug", [False, True])
@pytest.mark.parametrize(("n", "seed"), [(2, 0), (5, 1), (6, 2), (40, 3)])
def test_line_kernel_equals_the_reference(n: int, seed: int, debug: bool) -> None:
    """Observations, rewards, terms, endings, infos, state and draws, tick by tick."""
    ours = TwoRobotLine(n=n, debug=debug)
    steps = 10_000 if n == 40 else 3_000  # robots far apart seldom meet
    endings = ticks_alike(Reference(n=n), ours, choose=uniform(3), seed=seed, steps=steps)
    assert endings["met"] > 5
    assert ours.not_batched == ""


@pytest.mark.parametrize("n", [3, 9])
def test_line_kernel_meets_the_horizon_as_the_reference(n: int) -> None:
    """Robots that stand still are truncated in the same tick."""
    ends = ticks_alike(Reference(n=n), TwoRobotLine(n=n), choose=_stay, seed=0, steps=500)
    assert ends == {"horizon": 4}
    short = Reference(n=n, horizon=7), TwoRobotLine(n=n, horizon=7)
    assert ticks_alike(*short, choose=_stay, seed=0, steps=50) == {"horizon": 14}
    form = TwoRobotLine().declared
    assert form is not None
    assert form.schedule is not None
    assert form.schedule.horizon == HORIZON


@pytest.mark.parametrize("name", [*KNOBS, "all"])
def test_line_knobs_disturb_as_in_the_reference(name: str) -> None:
    """Each knob alone and all together: the same is seen, done and drawn."""
    knobs = HARD if name == "all" else {name: HARD[name]}
    ours = TwoRobotLine(n=7, **knobs)
    endings = ticks_alike(Reference(n=7, **knobs), ours, choose=uniform(3), seed=6, steps=1_000)
    assert endings["met"] > 5
    assert ours.not_batched == "knobs"


def test_line_lengths_and_horizons_share_compiled_code() -> None:
    """Numbers of the task are read as the rules run, so none of them makes a user wait."""
    kernels = [two_robot_line_kernel(n=n, horizon=horizon) for n, horizon in ((2, 7), (50, None))]
    assert kernel_key(kernels[0]) == kernel_key(kernels[1])


def test_line_batch_plays_as_copies_one_by_one() -> None:
    """Copy e of a batch plays the episodes e, e + 4, ... of the run."""
    envs, seeds = 4, EpisodeSeeds(11)
    batch = Batch(two_robot_line_kernel(n=6), envs, seed=11, debug=True)
    shown, faces = batch.reset(), [Reference(n=6) for _ in range(envs)]
    seen: list[Any] = [face.reset(seed=seeds[e])[0] for e, face in enumerate(faces)]
    numbers, rng = list(range(envs)), np.random.default_rng(0)
    for _ in range(300):
        for e, face in enumerate(faces):
            assert shown[e].tolist() == [seen[e][agent].tolist() for agent in face.possible_agents]
        actions = rng.integers(0, 3, (envs, 2))
        shown, rewards, terminated, truncated = batch.step(actions)
        for e, face in enumerate(faces):
            pair = zip(face.possible_agents, actions[e].tolist(), strict=True)
            seen[e], paid, ends, cuts, _ = face.step(dict(pair))
            assert [*paid.values()] == rewards[e].tolist()
            assert [*ends.values()] == terminated[e].tolist()
            assert [*cuts.values()] == truncated[e].tolist()
            if not face.agents:
                numbers[e] += envs
                seen[e] = face.reset(seed=seeds[numbers[e]])[0]
    assert min(numbers) > envs


@pytest.mark.parametrize("knobs", [{}, HARD | {"held_out": 1.0}])
def test_line_copies_go_on_alike(knobs: dict[str, Any]) -> None:
    """A deep copy, a pickle and a snapshot, into another instance too, go on as the original."""
    env, other = TwoRobotLine(n=30, **knobs), TwoRobotLine(n=30, **knobs)
    other.reset(seed=1)
    env.reset(seed=5)
    env.step({"picker": 2, "carrier": 1})
    other.restore(env.snapshot())
    counterfactuals = [copy.deepcopy(env), pickle.loads(pickle.dumps(env)), other]
    for actions in ({"picker": 0, "carrier": 2}, {"picker": 2, "carrier": 0}) * 3:
        told = repr((env.step(actions), env.state()))
        assert [told] * 3 == [
            repr((counterfactual.step(actions), counterfactual.state()))
            for counterfactual in counterfactuals
        ]
    seen = repr(env.reset())
    assert [seen] * 3 == [repr(counterfactual.reset()) for counterfactual in counterfactuals]


def _stay(rng: Any, seen: Any, info: Any) -> int:
    return 1
