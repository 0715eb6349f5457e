"""The example that learns: what it saves plays as a policy, and it computes what it says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gamekeeper as gk
from examples.ppo_warehouse import Learner, Robots, Settings, interval, legal, played
from gamekeeper.kernels.batch import Batch
from tests.kernels.lines import WINDY

SMALL = Settings(copies=4, length=8, steps=100, minibatch=32, hidden=8)


def weights(folder: Path, *, seen: int, actions: int) -> Path:
    """A file of random weights."""
    rng, path = np.random.default_rng(0), folder / "weights.npz"
    sizes = {"0": (8, seen), "2": (8, 8), "4": (actions, 8)}
    layers = {f"actor.{at}.weight": rng.normal(0, 0.1, size) for at, size in sizes.items()}
    layers |= {f"actor.{at}.bias": rng.normal(0, 0.1, size[0]) for at, size in sizes.items()}
    np.savez(path, mean=np.zeros(seen), deviation=np.ones(seen), **layers)
    return path


def test_robots_play_legal_actions_by_what_they_see(tmp_path: Path) -> None:
    """Nothing that is masked out; the rest by chance; named by a digest of the weights."""
    robots, rng = Robots(weights(tmp_path, seen=3, actions=4)), np.random.default_rng(0)
    info = {"action_mask": np.array([1, 0, 1, 0], np.int8)}
    drawn = {robots(np.array([1, 2, 3], np.int16), "picker_0", info, rng) for _ in range(200)}
    assert drawn == {0, 2}
    assert len(robots.version) == 16


def test_robots_play_the_warehouse(tmp_path: Path) -> None:
    """As a policy for everybody, in evidence that replays."""
    robots = Robots(weights(tmp_path, seen=83, actions=6))
    few = {"pickers": 1, "carriers": 1, "spares": 0, "orders": 1, "horizon": 5, "debug": True}
    evidence = gk.rollout("warehouse", policies=robots, episodes=1, seed=0, env_kwargs=few)
    assert len(list(evidence.episodes)) == 1


def test_played_counts_the_first_episode_of_each_copy() -> None:
    """As many episodes as asked for, solved where somebody was terminated in the last tick."""
    found = played(Batch(WINDY, 12, seed=3, debug=True), legal(0))
    assert {name: len(values) for name, values in found.items()} == {
        "solved": 12,
        "delivered": 12,
        "return": 12,
    }
    assert set(found["solved"]) == {0.0, 1.0}
    mean, low, high = interval(found["solved"])
    assert 0.0 <= low <= mean <= high <= 1.0


@pytest.mark.trainer
def test_advantages_stop_at_ends_and_go_on_beyond_cuts() -> None:
    """Against the sum of discounted rewards, computed robot by robot and step by step."""
    pytest.importorskip("torch")
    learner = Learner(WINDY, replace(SMALL, gae_lambda=1.0), 0)
    steps = learner.play()
    found = (learner.advantages(steps) + steps.values).numpy()
    for e in range(SMALL.copies):
        for i in range(2):
            total = float(steps.after[e, i])
            for t in range(SMALL.length - 1, -1, -1):
                goes_on = bool(steps.goes_on[t, e, i])
                total = float(steps.rewards[t, e, i]) + (SMALL.discount * total if goes_on else 0.0)
                assert found[t, e, i] == pytest.approx(total, abs=1e-4)


@pytest.mark.trainer
def test_learner_saves_what_robots_play(tmp_path: Path) -> None:
    """The network in NumPy gives the probabilities that torch gives."""
    torch = pytest.importorskip("torch")
    learner = Learner(WINDY, SMALL, 0)
    assert list(learner.run())[-1] >= SMALL.steps
    learner.save(tmp_path / "weights.npz")
    robots, arrays = Robots(tmp_path / "weights.npz"), learner.batch.arrays
    seen, masks = arrays.obs[0, 0], arrays.masks[0, 0]
    with torch.no_grad():
        scaled = learner.scaled(torch.from_numpy(seen).float())
        expected = learner.logits(scaled, torch.from_numpy(masks)).softmax(-1).numpy()
    rng = np.random.default_rng(0)
    drawn = [robots(seen, "picker", {"action_mask": masks}, rng) for _ in range(4_000)]
    assert np.bincount(drawn, minlength=3) / 4_000 == pytest.approx(expected, abs=0.03)


@pytest.mark.trainer
def test_learner_gets_better_on_a_line(tmp_path: Path) -> None:
    """Robots that learnt meet more often than robots that don't care."""
    pytest.importorskip("torch")
    settings = replace(SMALL, copies=64, length=16, steps=40_000, minibatch=512, hidden=32)
    learner = Learner(WINDY, settings, 0)
    for _ in learner.run():
        pass
    not_exercised = Batch(WINDY, 200, seed=9)
    before = played(not_exercised, legal(0))["solved"].mean()
    after = played(not_exercised, learner.act)["solved"].mean()
    assert after > before + 0.1
