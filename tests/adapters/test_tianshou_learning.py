"""Tianshou's algorithms learn from what our environments give them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from tests.adapters.tianshou_play import SPREAD, TIRED, Echo, first_board, made

pytestmark = [
    pytest.mark.trainer,
    # Of Tianshou itself and what it stands on, as they are imported.
    pytest.mark.filterwarnings("ignore::DeprecationWarning:tianshou.*"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:sensai.*"),
]


def ppo(env: Any, hidden: int = 8, lr: float = 1e-3, **options: Any) -> Any:
    """A small PPO for one of the environment's agents."""
    from tianshou.algorithm import PPO
    from tianshou.algorithm.modelfree.reinforce import DiscreteActorPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.utils.net.common import Net
    from tianshou.utils.net.discrete import DiscreteActor, DiscreteCritic

    from gamekeeper.adapters.tianshou import masked, unmasked

    shape, actions = env.observation_space.shape, int(env.action_space.n)
    nets = [Net(state_shape=shape, hidden_sizes=[hidden]) for _ in range(2)]
    actor: Any = DiscreteActor(preprocess_net=nets[0], action_shape=actions, softmax_output=False)
    critic: Any = DiscreteCritic(preprocess_net=nets[1])
    if env.slots.masks is not None:
        actor, critic = masked(actor), unmasked(critic)
    policy = DiscreteActorPolicy(actor=actor, action_space=env.action_space, **options)
    return PPO(policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=lr))


@pytest.mark.parametrize(
    ("spec", "algorithms", "kwargs"),
    [
        ("warehouse", "one", TIRED),
        (SPREAD, "one", {}),
        (SPREAD, "agent", {}),
        ("speaker_listener", "role", {}),
        ("tictactoe", "agent", {}),
    ],
)
def test_ppo_trains(spec: str, algorithms: str, kwargs: Any) -> None:
    """A few updates by Tianshou's trainer, with tests of whole episodes; then it plays."""
    from tianshou.algorithm.multiagent.marl import MultiAgentOnPolicyAlgorithm
    from tianshou.trainer import OnPolicyTrainerParams

    from gamekeeper.adapters import tianshou

    env = made(spec, algorithms=algorithms, env_kwargs=kwargs)
    tests = made(spec, algorithms=algorithms, env_kwargs=kwargs, repeats=True, seed=9)
    each = [ppo(env) for _ in env.agents]
    learner = MultiAgentOnPolicyAlgorithm(algorithms=each, env=env) if env.is_multi else each[0]
    before = tianshou.policy(learner, env).version
    info = learner.run_training(
        OnPolicyTrainerParams(
            training_collector=tianshou.Collector(learner, env),
            test_collector=tianshou.Collector(learner, tests),
            test_step_num_episodes=2,
            max_epochs=1,
            epoch_num_steps=64,
            collection_step_num_env_steps=32,
            batch_size=16,
            update_step_num_repetitions=1,
            show_progress=False,
            verbose=False,
        )
    )
    assert info.train_step >= 64
    assert info.test_episode == 4
    learnt = tianshou.policy(learner, env)
    assert learnt.version != before
    evidence = gk.rollout(spec, policies=learnt, episodes=1, seed=0, env_kwargs=kwargs)
    assert learnt.version in evidence.episode_table.to_pylist()[0]["policies"]


def test_parts_of_a_policy_know_that_they_are_learning() -> None:
    """Tianshou tells only the whole: its parts would take the likeliest action, or no noise."""
    from tianshou.algorithm.multiagent.marl import MultiAgentOnPolicyAlgorithm

    from gamekeeper.adapters import tianshou

    env = made("tictactoe", algorithms="agent")
    learner = MultiAgentOnPolicyAlgorithm(algorithms=[ppo(env) for _ in env.agents], env=env)
    collector = tianshou.Collector(learner, env)
    collector.reset()
    for learns in (True, False):
        learner.policy.is_within_training_step = learns
        collector.collect(n_step=2)
        parts = learner.policy.policies.values()
        assert [part.is_within_training_step for part in parts] == [learns, learns]


def test_each_part_learns_what_is_its_own() -> None:
    """Right answers that differ from agent to agent are soon known: credit, masks, both nets."""
    import torch
    from tianshou.algorithm.multiagent.marl import MultiAgentOnPolicyAlgorithm
    from tianshou.trainer import OnPolicyTrainerParams

    from gamekeeper.adapters import tianshou

    torch.manual_seed(0)
    env = made(Echo, 8, algorithms="agent")
    learner = MultiAgentOnPolicyAlgorithm(
        algorithms=[ppo(env, hidden=32, lr=1e-2) for _ in env.agents], env=env
    )
    learner.run_training(
        OnPolicyTrainerParams(
            training_collector=tianshou.Collector(learner, env),
            max_epochs=1,
            epoch_num_steps=1_536,
            collection_step_num_env_steps=256,
            batch_size=64,
            update_step_num_repetitions=4,
            show_progress=False,
            verbose=False,
        )
    )
    evidence = gk.rollout(Echo, policies=tianshou.policy(learner, env), episodes=25, seed=9)
    paid = [row["reward"] for row in evidence.agent_steps.to_pylist() if row["reward"] is not None]
    assert sum(paid) >= 48  # of 50; chance has 12
    env.close()


def test_drawn_actions_are_drawn() -> None:
    """Whatever `deterministic_eval` says, and without a draw from anybody's generator."""
    import torch

    from gamekeeper.adapters import tianshou

    env = made("tictactoe", 1)
    learner = ppo(env, deterministic_eval=True)
    given, info = first_board()
    state = torch.random.get_rng_state()
    rng = np.random.default_rng(0)
    found = {}
    for deterministic in (True, False):
        policy = tianshou.policy(learner, env, deterministic=deterministic)
        found[deterministic] = {policy(given, "player_1", info, rng) for _ in range(30)}
    assert len(found[True]) == 1
    assert len(found[False]) > 3
    assert torch.equal(state, torch.random.get_rng_state())
    env.close()


def test_dqn_trains_on_masks() -> None:
    """Off-policy: masks of what follows too, and exploration within them."""
    from tianshou.algorithm import DQN
    from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.trainer import OffPolicyTrainerParams
    from tianshou.utils.net.common import Net

    from gamekeeper.adapters import tianshou

    env = made("tictactoe")
    net = Net(state_shape=env.observation_space.shape, action_shape=9, hidden_sizes=[8])
    policy = DiscreteQLearningPolicy(model=net, action_space=env.action_space, eps_training=0.5)
    learner = DQN(policy=policy, optim=AdamOptimizerFactory(lr=1e-3), target_update_freq=10)
    collector = tianshou.Collector(learner, env, exploration_noise=True)
    learner.run_training(
        OffPolicyTrainerParams(
            training_collector=collector,
            max_epochs=1,
            epoch_num_steps=40,
            collection_step_num_env_steps=10,
            batch_size=8,
            show_progress=False,
            verbose=False,
        )
    )
    kept = collector.buffer[:]
    assert len(kept) >= 40
    assert kept.obs.mask[np.arange(len(kept)), kept.act].all()
    evidence = gk.rollout("tictactoe", policies=tianshou.policy(learner, env), episodes=1, seed=0)
    assert len(list(evidence.episodes)) == 1
