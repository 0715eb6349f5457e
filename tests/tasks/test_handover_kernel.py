"""The kernel of `handover` plays as the rules written by hand."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from gamekeeper.kernels.batch import Batch
from gamekeeper.randomness.seeds import EpisodeSeeds
from gamekeeper.tasks.handover import handover_rules as policies
from gamekeeper.tasks.handover.handover import Handover, handover_kernel
from gamekeeper.tasks.handover.handover_rules import HORIZON
from gamekeeper.tasks.knobs import LABELS
from tests.references.handover import Handover as Reference
from tests.tasks.alike import Choose, legal_often, turns_alike

HARD: dict[str, Any] = dict.fromkeys(LABELS, 0.2) | {
    "observation_delay": 2,
    "latency": {"giver": 1},
    "slowness": {"receiver_0": 1},
}
SIZES: tuple[dict[str, int], ...] = (
    {},
    {"reach": 1, "shared": 1},
    {"reach": 3, "shared": 4, "gap": 5},
    {"gap": 1},
)
"""One shape of state, so that one kernel is compiled for all."""


def played_by(env: Reference, policy: str) -> Choose:
    """What the policy does, at times something else."""
    chosen, share = getattr(policies, policy), 0.01

    def choose(rng: Any, seen: Any, info: Any) -> int:
        if rng.random() < share:
            return legal_often(rng, seen, info)
        return int(chosen(seen, env.agent_selection, info, rng))

    return choose


@pytest.mark.parametrize("debug", [False, True])
@pytest.mark.parametrize("seed", range(len(SIZES)))
def test_handover_kernel_equals_the_reference(seed: int, debug: bool) -> None:
    """Random play: all that is seen, paid, told and drawn, turn by turn."""
    sizes, steps = SIZES[seed], 1_000 if debug else 4_000
    one, two = Reference(**sizes), Handover(**sizes, debug=debug)
    endings = turns_alike(one, two, choose=legal_often, seed=seed, steps=steps)
    assert len(endings) > 1
    assert two.not_batched == ""


@pytest.mark.parametrize("policy", ["reference", "greedy", "lazy"])
@pytest.mark.parametrize("sizes", [SIZES[0], {"parts": 9, "tray": 3, "reach": 3}])
def test_handover_kernel_follows_policies_as_the_reference(
    sizes: dict[str, int], policy: str
) -> None:
    """Whole episodes, in which parts arrive, are handed over, delivered and fall off."""
    one, two = Reference(**sizes), Handover(**sizes, debug="parts" in sizes)
    endings = turns_alike(one, two, choose=played_by(one, policy), seed=7, steps=1_500)
    assert ("overflow" if policy == "lazy" else "done") in endings


def test_handover_kernel_meets_its_horizon_as_the_reference() -> None:
    """Ticks are counted alike, and a batch has the contract's horizon as an environment has."""
    one, two = Reference(horizon=20), Handover(horizon=20, debug=True)
    assert "horizon" in turns_alike(one, two, choose=legal_often, seed=5, steps=1_000)
    form = Handover(debug=True).declared
    assert form is not None
    assert form.schedule is not None
    assert form.schedule.horizon == HORIZON


@pytest.mark.parametrize("name", [*LABELS, "all"])
def test_handover_knobs_disturb_as_in_the_reference(name: str) -> None:
    """Each knob alone and all together: the same is seen, done, paid for and drawn."""
    knobs = HARD if name == "all" else {name: HARD[name]}
    one, two = Reference(**knobs), Handover(**knobs)
    turns_alike(one, two, choose=played_by(one, "reference"), seed=8, steps=400)
    turns_alike(one, two, choose=legal_often, seed=9, steps=200)
    assert two.not_batched == "knobs"


def test_handover_batch_plays_as_copies_one_by_one() -> None:
    """Copy e of a batch plays the episodes e, e + 3, ... of the run."""
    envs, seeds, rng = 3, EpisodeSeeds(12), np.random.default_rng(0)
    batch = Batch(handover_kernel(), envs, seed=12, debug=True)
    shown, faces = batch.reset(), [Reference() for _ in range(envs)]
    for e, face in enumerate(faces):
        face.reset(seed=seeds[e])
    numbers = list(range(envs))
    for _ in range(300):
        actions = np.zeros(envs, np.int64)
        for e, face in enumerate(faces):
            seen, *_, info = face.last()
            assert face.possible_agents[batch.arrays.turn[e]] == face.agent_selection
            assert shown[e].tolist() == seen.tolist()
            assert batch.arrays.masks[e].tolist() == info["action_mask"].tolist()
            actions[e] = rng.choice(np.flatnonzero(info["action_mask"]))
        shown, rewards, terminated, truncated = batch.step(actions)
        for e, face in enumerate(faces):
            face.step(int(actions[e]))
            assert [*face.rewards.values()] == rewards[e].tolist()
            assert [*face.terminations.values()] == terminated[e].tolist()
            assert [*face.truncations.values()] == truncated[e].tolist()
            if face.endings:
                numbers[e] += envs
                face.reset(seed=seeds[numbers[e]])
    assert min(numbers) > envs


def test_handover_pickles_go_on_alike() -> None:
    """A pickle, and a snapshot in another instance, go on as the original, layout and all."""
    env, other = Handover(held_out=0.5), Handover(held_out=0.5)
    for seed in range(6):
        env.reset(seed=seed)
        other.reset(seed=seed + 1)
        other.restore(env.snapshot())
        counterfactuals = [copy.deepcopy(env), pickle.loads(pickle.dumps(env)), other]
        for action in (policies.REACH, policies.WAIT, policies.REACH, policies.REACH):
            env.step(action)
            told = repr((env.state(), env.last()))
            for counterfactual in counterfactuals:
                counterfactual.step(action)
            assert [told] * 3 == [
                repr((counterfactual.state(), counterfactual.last()))
                for counterfactual in counterfactuals
            ]
