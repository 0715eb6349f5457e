"""Stable-Baselines3 trains on every kind of space that its adapter takes; the rest is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import gamekeeper as gk
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
def test_ppo_trains_on_every_kind_of_space(
    kind: dict[str, Any], spec: str, capsys: pytest.CaptureFixture[str]
) -> None:
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
    is_alone = kind.get("mask") == "observation" and kind["seen"] != "Dict"
    assert ("instead of MultiInputPolicy" in capsys.readouterr().err) == is_alone
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


def test_pixels_that_the_network_never_reads_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    """As many as have no gradient, for every size; an environment's picture is looked at."""
    import torch
    from stable_baselines3.common.torch_layers import NatureCNN

    from gamekeeper.adapters import sb3
    from gamekeeper.adapters.sb3.sb3_envs import unread

    for size in (41, 44, 64):
        net = NatureCNN(spaces.Box(0, 255, (1, 36, size), np.uint8))
        picture = torch.ones(1, 1, 36, size, requires_grad=True)
        net.cnn(picture).sum().backward()
        assert picture.grad is not None
        assert unread(size) == int((picture.grad.abs().sum((0, 1, 2)) == 0).sum())

    for side in (36, 40):
        sb3.vec_env(lambda n=side: Picture(n), 1, check=None).close()
    (said,) = capsys.readouterr().err.splitlines()
    assert "never reads the last 4 of 40 columns of 'observation' (fix: 36 or 44 columns" in said


class Picture(gk.TickEnv):
    """One agent that sees a picture of a width."""

    metadata = {"name": "picture_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, width: int) -> None:
        super().__init__(horizon=2)
        self.possible_agents = ["a"]
        self.observation_spaces = {"a": spaces.Box(0, 255, (36, width, 1), np.uint8)}
        self.action_spaces = {"a": spaces.Discrete(2)}

    def start(self, rng: Any, options: Any) -> None:
        """Nothing to begin."""

    def tick(self, actions: Any) -> None:
        """Nothing happens."""

    def observe(self, agent: Any) -> Any:
        return np.zeros(self.observation_spaces[agent].shape, np.uint8)
