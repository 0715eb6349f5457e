"""Normalized observations: statistics of decisions alone, kept with the policy wherever it goes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import PolicyError, SpecError
from tests.adapters import ledger

pytestmark = pytest.mark.trainer
CELL = ledger.Cell("Dict", mask=False, roles=1, ends="one by one", api="aec")


def learnt(cell: ledger.Cell, **options: Any) -> tuple[Any, Any]:
    """A model after a little learning, and its environment."""
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    venv = sb3.normalized(sb3.vec_env(cell.spec, 2, check=None, env_kwargs=cell.kwargs), **options)
    kind = "MultiInputPolicy" if cell.seen == "Dict" else "MlpPolicy"
    model = PPO(kind, venv, n_steps=30, batch_size=20, device="cpu", seed=0, **sb3.buffer(venv))
    return model.learn(60), venv


def test_statistics_are_those_of_decisions() -> None:
    """Rows of agents that wait or have ended don't count."""
    from gamekeeper.adapters import sb3

    cell = ledger.Cell("Box", mask=False, roles=1, ends="one by one", api="parallel")
    venv = sb3.normalized(sb3.vec_env(cell.spec, 2, check=None, env_kwargs=cell.kwargs))
    seen = []
    venv.reset()
    for _ in range(12):
        seen.append(np.array(venv.get_original_obs())[venv.slots.acting])
        venv.step(np.zeros((6, 1), np.float32))
    seen.append(np.array(venv.get_original_obs())[venv.slots.acting])
    rows = np.concatenate(seen)
    mean, variance, count = venv.now().parts[""]
    assert round(count) == len(rows)
    np.testing.assert_allclose(mean, rows.mean(0), rtol=1e-3)
    np.testing.assert_allclose(variance, rows.var(0), rtol=1e-3, atol=1e-3)
    venv.close()


def test_saved_policy_plays_as_the_one_in_memory(tmp_path: Path) -> None:
    """Statistics lie in the model's file; the same actions, the same version, and it learns on."""
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    model, venv = learnt(CELL)
    file = sb3.save(model, tmp_path / "model")
    one, two = sb3.policy(model), sb3.policy(file)
    assert one.version == two.version
    assert "normalized by" in one.version
    runs = [
        gk.rollout(CELL.spec, policies=p, episodes=2, seed=1, env_kwargs=CELL.kwargs)
        for p in (one, two)
    ]
    assert runs[0].agent_steps.equals(runs[1].agent_steps)
    again = sb3.normalized(
        sb3.vec_env(CELL.spec, 2, check=None, env_kwargs=CELL.kwargs), saved=file
    )
    assert again.now().to_json() == venv.now().to_json()
    PPO.load(file, env=again, device="cpu", **sb3.buffer(again)).learn(60)
    for each in (venv, again):
        each.close()


def test_saved_policy_without_its_statistics_is_refused(tmp_path: Path) -> None:
    """`model.save` leaves them out, which a policy that is loaded says."""
    from gamekeeper.adapters import sb3

    model, venv = learnt(CELL)
    model.save(tmp_path / "model")
    with pytest.raises(PolicyError, match="statistics aren't saved"):
        sb3.policy(tmp_path / "model.zip")
    with pytest.raises(PolicyError, match="has no statistics"):
        sb3.normalized(venv.venv, saved=tmp_path / "model.zip")
    venv.close()


def test_pictures_are_not_normalized() -> None:
    """Networks for pictures scale them; whole numbers have no spread."""
    from gamekeeper.adapters import sb3

    for seen in ("image", "Discrete"):
        cell = ledger.Cell(seen, mask=False, roles=1, ends="together", api="parallel")
        venv = sb3.vec_env(cell.spec, 1, check=None, env_kwargs=cell.kwargs)
        with pytest.raises(SpecError, match="no part to be normalized"):
            sb3.normalized(venv)
        sb3.normalized(venv, observations=False).close()
