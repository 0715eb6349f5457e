"""Agents learn to spread out over landmarks: MAPPO as BenchMARL runs it, over compiled copies.

    python examples/benchmarl_spread.py --seed 0

Needs BenchMARL (`pip install 'gamekeeper[benchmarl,fast]'`). Learns half of its steps, saves them
as BenchMARL does, goes on in an experiment that is read from the file, and plays 100 episodes out
of the last file, which are recorded and replayed. Prints one line of JSON; exits with 1 if what
was learnt isn't good enough.

Source: Bettini et al. 2024, "BenchMARL"; Yu et al. 2022, "The Surprising Effectiveness of PPO in
Cooperative Multi-Agent Games" (MAPPO: the critic sees the state).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from benchmarl.algorithms import MappoConfig
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig

import gamekeeper as gk
from gamekeeper.adapters.benchmarl import task
from gamekeeper.adapters.torchrl import policy
from gamekeeper.statistics.one_sample import one_sample

TASK: Final = "spread"
WANTED: Final = -21.5
"""An agent's mean return; random play gets -27.9 of the same seeds, the reference policy -8.8."""
COPIES: Final = 64
FRAMES: Final = 160_000
EPISODES: Final = 100
"""That judge; an interval of a mean needs 95."""


def settings(copies: int, frames: int, folder: str) -> ExperimentConfig:
    """Of an experiment on one core, without evaluations and logs in between."""
    config = ExperimentConfig.get_from_yaml()
    config.max_n_frames, config.gamma, config.lr = frames, 0.95, 1e-3
    config.on_policy_n_envs_per_worker = copies
    config.on_policy_collected_frames_per_batch = copies * 25
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = 4, copies * 25 // 4
    config.evaluation = config.render = config.create_json = False
    config.checkpoint_at_end = True
    config.loggers, config.save_folder = [], folder
    return config


def model() -> MlpConfig:
    """Two layers of 64."""
    return MlpConfig(
        num_cells=[64, 64], layer_class=torch.nn.Linear, activation_class=torch.nn.Tanh
    )


def experiment(spec: str, *, seed: int, config: ExperimentConfig, **options: Any) -> Experiment:
    """MAPPO on a task of Gamekeeper's."""
    algorithm = MappoConfig.get_from_yaml()
    algorithm.entropy_coef = 0.01
    return Experiment(
        task=task(spec, **options),
        algorithm_config=algorithm,
        model_config=model(),
        critic_model_config=model(),
        seed=seed,
        config=config,
    )


def learn(seed: int, frames: int, folder: Path, check: str | None) -> str:
    """Learns in two halves, with a file in between; returns the last file."""
    config = settings(COPIES, frames // 2, str(folder))
    run = experiment(TASK, seed=seed, config=config, engine="kernel", check=check)
    run.run()
    half = saved(run)
    run = Experiment.reload_from_file(half, {"max_n_frames": frames})
    run.run()
    return saved(run)


def saved(run: Experiment) -> str:
    """The experiment's newest checkpoint."""
    return str(Path(run.folder_name) / "checkpoints" / f"checkpoint_{run.total_frames}.pt")


def judge(file: str, seed: int, episodes: int, out: Path) -> Any:
    """An agent's mean return in each of some episodes that nobody learnt from."""
    run = Experiment.reload_from_file(file)
    env = run.task.get_env_fun(1, False, seed, "cpu")()
    evidence = gk.rollout(
        TASK, policies=policy(run.policy, env), episodes=episodes, seed=1_000, out=out
    )
    env.close()
    run.close()
    returns = evidence.agent_steps.group_by(["episode", "agent"]).aggregate([("reward", "sum")])
    means = returns.group_by("episode").aggregate([("reward_sum", "mean")])
    return means["reward_sum_mean"].to_numpy()


def main(arguments: list[str] | None = None) -> int:
    """Learns, plays 100 episodes, says what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a few steps, whatever comes of it")
    parser.add_argument("--check", default="quick", help="none: no audit before training")
    asked = parser.parse_args(arguments)
    torch.set_num_threads(1)
    frames = COPIES * 25 * (2 if asked.quick else FRAMES // (COPIES * 25))
    began_s = time.perf_counter()
    check = None if asked.check == "none" else asked.check
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(sys.stderr):
        folder = Path(name)
        file = learn(asked.seed, frames, folder, check)
        found = judge(file, asked.seed, 4 if asked.quick else EPISODES, folder / "run")
        is_replayed = gk.replay(folder / "run").verified
    result = float(np.mean(found))
    shown = None if asked.quick else one_sample(found, rng=np.random.default_rng(0))
    line = {
        "example": "benchmarl_spread",
        "trainer": f"benchmarl {version('benchmarl')}",
        "task": TASK,
        "seed": asked.seed,
        "steps": frames,
        "seconds": round(time.perf_counter() - began_s, 1),
        "measure": f"an agent's mean return over {EPISODES} episodes",
        "result": round(result, 2),
        "interval": shown and [round(shown.low, 2), round(shown.high, 2)],
        "replayed": is_replayed,
        "wanted": WANTED,
        "reached": result >= WANTED,
    }
    print(json.dumps(line))
    return 0 if is_replayed and (asked.quick or result >= WANTED) else 1


if __name__ == "__main__":
    sys.exit(main())
