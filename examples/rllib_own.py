"""RLlib's PPO learns an environment of one's own, two roles with different actions: `corridor.py`.

Needs `pip install 'gamekeeper[rllib]'`.

    python examples/rllib_own.py --seed 0

A module for each role learns half of the steps; the algorithm is saved, and another one goes on
from the checkpoint, learns the rest and is saved again. Out of that checkpoint 200 games are played
that weren't learnt from, recorded and replayed. One JSON line; exit status 1 if the wanted result
isn't reached.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small networks: more threads only wait

import numpy as np
from corridor import FRESH, GAMES, SPEC, WANTED, mean_returns

import gamekeeper as gk
from gamekeeper.statistics.one_sample import one_sample

STEPS: Final = 30_000
"""Ticks that are learnt from; half of them before the algorithm is saved and restored."""
QUICK: Final = 4_000


def config(seed: int) -> Any:
    """PPO in this process, with a masked module for each role."""
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from gamekeeper.adapters import rllib

    network = DefaultModelConfig(fcnet_hiddens=[64, 64])
    return (
        PPOConfig()
        .environment(rllib.register(SPEC, seed=seed), disable_env_checking=True)
        .env_runners(num_env_runners=0, num_envs_per_env_runner=16)
        .multi_agent(**rllib.policy_mapping(SPEC))
        .rl_module(rl_module_spec=rllib.modules(SPEC, model_config=network))
        .training(
            lr=1e-3,
            train_batch_size_per_learner=1_500,
            minibatch_size=250,
            num_epochs=6,
            entropy_coeff=0.01,
            gamma=0.95,
            lambda_=0.9,
        )
        .callbacks(rllib.ReturnsCallback)
        .debugging(seed=seed)
    )


def learn(seed: int, steps: int, folder: Path) -> Path:
    """Learns in two halves, the second by an algorithm that is restored from the first one's file.

    Returns:
        The last checkpoint.
    """
    checkpoint = None
    for half in (1, 2):
        algorithm = config(seed + 1_000 * (half - 1)).build_algo()
        if checkpoint is not None:
            algorithm.restore_from_path(str(checkpoint))
        done = 0
        while done < steps * half // 2:
            found = algorithm.train()["env_runners"]
            done = int(found["num_env_steps_sampled_lifetime"])
            roles = {r: round(float(paid), 3) for r, paid in found["gamekeeper"]["role"].items()}
            print({"steps": done, **roles}, file=sys.stderr)
        checkpoint = Path(algorithm.save_to_path(str(folder / f"half_{half}")))
        algorithm.stop()
    return checkpoint


def judge(policies: Any, out: Path) -> list[float]:
    """Mean return of an agent in each of some games that weren't learnt from."""
    return mean_returns(gk.rollout(SPEC, policies=policies, episodes=GAMES, seed=FRESH, out=out))


def main() -> int:
    """Learns with one seed and prints what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a short run that shows that it runs")
    given = parser.parse_args()
    import ray

    from gamekeeper.adapters import rllib

    began_s = time.perf_counter()
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        checkpoint = learn(given.seed, QUICK if given.quick else STEPS, folder)
        ray.shutdown()
        found = judge(f"rllib:{checkpoint}", folder / "run")
        is_replayed = gk.replay(folder / "run").verified
    result, shown = float(np.mean(found)), one_sample(found, rng=np.random.default_rng(0))
    line = {
        "example": "rllib_own",
        "trainer": f"rllib {rllib.VERSION}",
        "seed": given.seed,
        "steps": QUICK if given.quick else STEPS,
        "seconds": round(time.perf_counter() - began_s, 1),
        "measure": "mean return of an agent",
        "result": round(result, 3),
        "interval": [round(shown.low, 3), round(shown.high, 3)],
        "replayed": is_replayed,
        "wanted": WANTED,
        "reached": result >= WANTED,
    }
    print(json.dumps(line))
    return 0 if is_replayed and (given.quick or result >= WANTED) else 1


if __name__ == "__main__":
    sys.exit(main())
