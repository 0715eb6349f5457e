"""Tianshou collects and learns from every kind of space that its adapter takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from gamekeeper.errors import SpecError
from tests.adapters import kinds
from tests.adapters.tianshou_play import first_legal, made

pytestmark = [
    pytest.mark.trainer,
    # Of Tianshou itself and what it stands on, as they are imported.
    pytest.mark.filterwarnings("ignore::DeprecationWarning:tianshou.*"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:sensai.*"),
]
REFUSED = {
    ("seen", "Tuple"): "no tuples of observations",
    ("done", "Dict"): "actions in parts",
    ("done", "Tuple"): "actions in parts",
}
MASKED_PARTS = {("done", "MultiDiscrete"): "masks Discrete actions alone"}


def ppo(env: Any) -> Any:
    """A small PPO whose networks read anything, as one row of numbers."""
    import torch
    from tianshou.algorithm import PPO
    from tianshou.algorithm.modelfree.reinforce import DiscreteActorPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.data import Batch
    from tianshou.utils.net.common import ModuleWithVectorOutput
    from tianshou.utils.net.discrete import DiscreteActor, DiscreteCritic

    from gamekeeper.adapters.tianshou import masked, unmasked

    class Row(ModuleWithVectorOutput):
        def __init__(self) -> None:
            super().__init__(8)
            self.layer = torch.nn.LazyLinear(8)

        def forward(self, obs: Any, state: Any = None, info: Any = None) -> Any:
            return torch.tanh(self.layer(torch.cat(self.leaves(obs), -1) / 255)), state

        def leaves(self, obs: Any) -> list[Any]:
            if isinstance(obs, Batch):
                return [leaf for key in sorted(obs.get_keys()) for leaf in self.leaves(obs[key])]
            return [torch.as_tensor(obs, dtype=torch.float32).reshape(len(obs), -1)]

    torch.manual_seed(0)
    nets = [Row(), Row()]
    first, _ = env.reset()
    bare = first.obs if env.slots.masks is not None else first
    for net in nets:
        net(bare)  # so that the layers know how long a row is
    actor: Any = DiscreteActor(
        preprocess_net=nets[0], action_shape=int(env.action_space.n), softmax_output=False
    )
    critic: Any = DiscreteCritic(preprocess_net=nets[1])
    if env.slots.masks is not None:
        actor, critic = masked(actor), unmasked(critic)
    policy = DiscreteActorPolicy(actor=actor, action_space=env.action_space)
    return PPO(policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=1e-3))


@pytest.mark.parametrize("spec", [kinds.HERE, kinds.TURNS], ids=["parallel", "aec"])
@pytest.mark.parametrize("kind", kinds.EACH, ids=kinds.name)
def test_every_kind_of_space_is_learnt_from(kind: dict[str, Any], spec: str) -> None:
    """Decisions are collected; where actions are Discrete, PPO learns from them and plays."""
    from tianshou.trainer import OnPolicyTrainerParams

    from gamekeeper.adapters import tianshou

    options = {"env_kwargs": kind, **kinds.cast(kind)}
    says = kinds.refusal(kind, REFUSED | (MASKED_PARTS if "mask" in kind else {}))
    if says is not None:
        with pytest.raises(SpecError, match=says):
            made(spec, 2, **options)
        return
    env = made(spec, 2, **options)
    collector = tianshou.Collector(first_legal(env), env)
    collector.reset()
    stats = collector.collect(n_episode=2, random=True)
    held = collector.buffer[: len(collector.buffer)]
    assert stats.n_collected_steps == len(held) > 0
    assert np.isfinite(held.rew).all()
    if isinstance(env.action_space, spaces.Discrete):
        learner = ppo(env)
        before = tianshou.policy(learner, env).version
        learner.run_training(
            OnPolicyTrainerParams(
                training_collector=tianshou.Collector(learner, env),
                max_epochs=1,
                epoch_num_steps=32,
                collection_step_num_env_steps=16,
                batch_size=8,
                update_step_num_repetitions=1,
                show_progress=False,
                verbose=False,
            )
        )
        learnt = tianshou.policy(learner, env)
        assert learnt.version != before
        kinds.plays(spec, kind, learnt)
    env.close()


def test_masked_networks_serve_environments_without_masks() -> None:
    """One program for both: `masked` and `unmasked` change nothing where there is no mask."""
    import torch
    from tianshou.utils.net.common import Net
    from tianshou.utils.net.discrete import DiscreteActor, DiscreteCritic

    from gamekeeper.adapters.tianshou import masked, unmasked

    env = made(kinds.HERE, 2)
    rows, _ = env.reset()
    net = Net(state_shape=2, hidden_sizes=[4])
    actor = DiscreteActor(preprocess_net=net, action_shape=3, softmax_output=False)
    critic = DiscreteCritic(preprocess_net=net)
    assert torch.equal(masked(actor)(rows)[0], actor(rows)[0])
    assert torch.equal(unmasked(critic)(rows), critic(rows))
    env.close()
