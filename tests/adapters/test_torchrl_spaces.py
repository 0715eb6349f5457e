"""TorchRL's specs hold every kind of space, nested and as one vector, and PPO learns from them."""

from __future__ import annotations

from typing import Any

import pytest

from tests.adapters import kinds
from tests.adapters.torchrl_views import made

pytestmark = [
    pytest.mark.trainer,
    # Of TorchRL's own classes, as they are imported.
    pytest.mark.filterwarnings(
        "ignore:Creating .* which inherits from WeightUpdaterBase:DeprecationWarning"
    ),
]
PARTS = ("Dict", "Tuple")


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Two threads would spin for each other where other work has the cores."""
    import torch

    torch.set_num_threads(1)


@pytest.mark.parametrize("spec", [kinds.HERE, kinds.TURNS], ids=["parallel", "aec"])
@pytest.mark.parametrize("kind", kinds.EACH, ids=kinds.name)
def test_specs_hold_every_kind_of_space(kind: dict[str, Any], spec: str) -> None:
    """What is seen and paid over two episodes is in its spec; legal actions are played."""
    import torch

    from gamekeeper.adapters import torchrl

    for flatten in (False, True):
        env = made(spec, None, env_kwargs=kind, flatten=flatten)
        torch.manual_seed(0)
        batch = env.rollout(30, break_when_any_done=False)
        for step in (batch[0], batch[-1]):
            assert env.observation_spec.is_in(step.select(*env.observation_spec.keys()))
            assert env.full_reward_spec.is_in(step["next"].select(*env.full_reward_spec.keys()))
        assert int(batch["next", "done"].sum()) >= 2
        if kind.get("done") not in PARTS:
            kinds.plays(spec, kind, torchrl.policy(drawing(env), env))
        env.close()


def drawing(env: Any) -> Any:
    """An actor that draws legal actions."""
    import torch

    class Draws(torch.nn.Module):
        def forward(self, tensordict: Any) -> Any:
            for group in env.group_map:  # of the others a policy knows nothing
                if (group, "action_mask") in tensordict.keys(include_nested=True):
                    others = ~tensordict[group, "mask"]
                    tensordict[group, "action_mask"][others] = True
            return env.rand_action(tensordict)

    return Draws()


@pytest.mark.parametrize("spec", [kinds.HERE, kinds.TURNS], ids=["parallel", "aec"])
@pytest.mark.parametrize(
    "kind",
    [kind for kind in kinds.EACH if kind.get("done", "Discrete").startswith("Discrete")],
    ids=kinds.name,
)
def test_ppo_trains_on_every_kind_of_observation(kind: dict[str, Any], spec: str) -> None:
    """Two updates of TorchRL's own loss; then the actor plays what it learnt."""
    import torch

    from examples.torchrl_spread import Learner
    from gamekeeper.adapters import torchrl

    torch.manual_seed(0)
    env = made(spec, 2, masks=True, flatten=True, env_kwargs=kind)
    learner = Learner(env)
    before = torchrl.policy(learner.actor, env).version
    for batch in learner.batches(frames=32, total=64):
        learner.learn(batch)
    learnt = torchrl.policy(learner.actor, env)
    assert learnt.version != before
    env.close()
    kinds.plays(spec, kind, learnt)
