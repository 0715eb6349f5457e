"""BenchMARL's experiments run on tasks of ours: groups, masks, turns, states, what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import ContractError, SpecError

pytestmark = [
    pytest.mark.trainer,
    # Of TorchRL's and BenchMARL's own: classes as they are imported, a collector by its old name.
    pytest.mark.filterwarnings(
        "ignore:Creating .* which inherits from WeightUpdaterBase:DeprecationWarning",
        "ignore:SyncDataCollector has been deprecated:DeprecationWarning",
        "ignore:.*:DeprecationWarning:(benchmarl|torchrl|tensordict|hydra).*",
        "ignore:.*:UserWarning:(benchmarl|torchrl|tensordict|torch).*",
        "ignore:.*:FutureWarning:(benchmarl|torchrl|tensordict|torch).*",
    ),
]
TAG = "mpe2.simple_tag_v3:parallel_env"
FOUR = "pettingzoo.classic.connect_four_v3:env"
LATE = Path(__file__).with_name("late_joins.py")


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Two threads would spin for each other where other work has the cores."""
    import torch

    torch.set_num_threads(1)


def ran(algorithm: Any, spec: str, folder: Path, **options: Any) -> Any:
    """A few frames of an experiment."""
    from benchmarl.experiment import Experiment, ExperimentConfig

    from examples.benchmarl_spread import model, settings
    from gamekeeper.adapters.benchmarl import task

    config: ExperimentConfig = settings(4, 160, str(folder))
    config.on_policy_collected_frames_per_batch = config.off_policy_collected_frames_per_batch = 80
    config.on_policy_minibatch_size = config.off_policy_train_batch_size = 40
    config.off_policy_n_envs_per_worker, config.off_policy_n_optimizer_steps = 4, 2
    config.off_policy_init_random_frames = 40
    config.evaluation, config.evaluation_interval, config.evaluation_episodes = True, 80, 2
    config.create_json = True
    options = {"check": None, "max_steps": 30, **options}
    run = Experiment(
        task=task(spec, **options),
        algorithm_config=algorithm.get_from_yaml(),
        model_config=model(),
        seed=0,
        config=config,
    )
    run.run()
    return run


@pytest.mark.parametrize(
    ("algorithm", "spec", "options"),
    [
        ("MappoConfig", "warehouse", {"engine": "kernel"}),
        ("IppoConfig", TAG, {}),
        ("QmixConfig", "two_robot_line", {}),
        ("IqlConfig", "warehouse", {"role": "picker", "others": {"carrier": "reference"}}),
        ("MappoConfig", FOUR, {}),
        ("IppoConfig", "late", {}),
        (
            "MaddpgConfig",
            "mpe2.simple_spread_v3:parallel_env",
            {"env_kwargs": {"continuous_actions": True}},
        ),
    ],
)
def test_experiment_runs(
    algorithm: str, spec: str, options: dict[str, Any], tmp_path: Path
) -> None:
    """On policy and off, with masks, turns, late joins, two roles, vectors of actions."""
    from benchmarl import algorithms

    spec = f"{LATE}:Late" if spec == "late" else spec
    run = ran(getattr(algorithms, algorithm), spec, tmp_path, **options)
    assert run.total_frames == 160
    assert list(tmp_path.glob("*/*.json"))


def test_policy_of_an_experiment_plays_and_is_replayed(tmp_path: Path) -> None:
    """What was learnt is evidence as any other policy's."""
    from benchmarl.algorithms import MappoConfig

    from gamekeeper.adapters.torchrl import policy

    run = ran(MappoConfig, "warehouse", tmp_path / "", engine="kernel")
    env = run.task.get_env_fun(1, False, 0, "cpu")()
    learnt = policy(run.policy, env)
    gk.rollout("warehouse", policies=learnt, episodes=1, seed=0, out=tmp_path / "runs")
    assert gk.replay(tmp_path / "runs").verified
    env.close()


def test_groups_are_told_apart() -> None:
    """Each role's specs stand under its name, without a batch; places have one legal action."""
    from gamekeeper.adapters.benchmarl import task

    made = task(TAG, check=None, max_steps=25)
    env = made.get_env_fun(3, False, 7, "cpu")()
    assert made.group_map(env) == {
        "adversary": ["adversary_0", "adversary_1", "adversary_2"],
        "agent": ["agent_0"],
    }
    assert made.observation_spec(env)["adversary", "observation"].shape == (3, 16)
    assert made.action_mask_spec(env)["agent", "action_mask"].shape == (1, 5)
    assert made.action_spec(env)["adversary", "action"].shape == (3,)
    assert (made.supports_discrete_actions(), made.supports_continuous_actions()) == (True, False)
    env.close()


def test_seeds_are_the_experiments() -> None:
    """The seed names the run; copy i begins with its episode i."""
    from gamekeeper.adapters.benchmarl import task

    made = task("warehouse", check=None, engine="kernel")
    env = made.get_env_fun(2, False, 7, "cpu")()
    seen = env.reset()["picker", "observation"]
    episodes = list(gk.rollout("warehouse", policies="noop", episodes=2, seed=7).episodes)
    for copy, episode in enumerate(episodes):
        first = episode.turns[0]
        np.testing.assert_array_equal(
            np.asarray(first.observations["picker_0"], np.float32).ravel(), seen[copy, 0].numpy()
        )
    env.close()


def test_each_agents_return_is_logged() -> None:
    """Over the episodes that ended in a batch, agent by agent."""
    from torchrl.envs import TransformedEnv

    from gamekeeper.adapters.benchmarl import task

    made = task("two_robot_line", check=None)
    env = made.get_env_fun(2, False, 0, "cpu")()
    made.group_map(env)
    whole = TransformedEnv(env, made.get_reward_sum_transform(env))
    batch = whole.rollout(made.max_steps(env) + 2, break_when_any_done=False)
    told = made.log_info(batch)
    assert set(told) == {
        "collection/picker/picker/episode_return",
        "collection/carrier/carrier/episode_return",
    }
    env.close()


def test_what_benchmarl_cant_is_refused() -> None:
    """Objects, mixed actions, no horizon, broken contracts: each says how to fix it."""
    from gamekeeper.adapters.benchmarl import task

    with pytest.raises(SpecError, match="is saved"):
        task(lambda: None)  # type: ignore[arg-type]  # refused
    with pytest.raises(SpecError, match="length of an evaluation episode"):
        task(TAG, check=None)
    with pytest.raises(ContractError, match="breaks its contract"):
        task(f"{LATE}:Leaky", max_steps=10)
