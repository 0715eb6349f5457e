"""Stable-Baselines3 trains on every kind of space that its adapter takes; the rest is refused."""

from __future__ import annotations

from typing import Any

import pytest
from gymnasium import spaces

from gamekeeper.errors import SpecError
from tests.adapters import kinds

pytestmark = pytest.mark.trainer
REFUSED = {
    ("seen", "nested Dict"): "in parts",
    ("seen", "Tuple"): "in parts",
    ("done", "Dict"): "in parts",
    ("done", "Tuple"): "in parts",
    ("seen", "MultiDiscrete 2D"): "more than one axis",
    ("seen", "Discrete from 2"): "count from 0",
    ("done", "Discrete from 1"): "count from 0",
}


def network(space: Any) -> str:
    """The name of the policy that reads such observations."""
    if isinstance(space, spaces.Dict):
        return "MultiInputPolicy"
    return "CnnPolicy" if len(space.shape) == 3 else "MlpPolicy"


@pytest.mark.parametrize("spec", [kinds.HERE, kinds.TURNS], ids=["parallel", "aec"])
@pytest.mark.parametrize("kind", kinds.EACH, ids=kinds.name)
def test_ppo_trains_on_every_kind_of_space(kind: dict[str, Any], spec: str) -> None:
    """Two updates, masked where there are masks; then it plays what it learnt."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    options = {"check": None, "env_kwargs": kind, **kinds.cast(kind)}
    says = kinds.refusal(kind, REFUSED)
    if says is not None:
        with pytest.raises(SpecError, match=says):
            sb3.vec_env(spec, 2, **options)
        return
    venv = sb3.vec_env(spec, 2, **options)
    masked = venv.has_attr("action_masks")
    assert masked == ("mask" in kind)
    model = (MaskablePPO if masked else PPO)(
        network(venv.observation_space),
        venv,
        n_steps=16,
        batch_size=16,
        n_epochs=1,
        device="cpu",
        seed=0,
        **sb3.buffer(venv, masked=masked),
    )
    before = sb3.policy(model).version
    model.learn(venv.num_envs * 16 * 2)
    learnt = sb3.policy(model)
    assert learnt.version != before
    assert all(bool(weight.isfinite().all()) for weight in model.policy.state_dict().values())
    kinds.plays(spec, kind, learnt)
    venv.close()
