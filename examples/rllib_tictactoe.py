"""RLlib's PPO learns to begin in tictactoe, against an opponent that plays inside the environment.

Illegal cells are masked out, and what the game pays comes to the mark that it was set for. Run it
with gamekeeper[rllib]:

    python examples/rllib_tictactoe.py --seed 0

It prints one JSON line; the exit code is 1 where the wanted result isn't reached.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from typing import Any, Final

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small networks: more threads only wait

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

import gamekeeper as gk
from gamekeeper.adapters import rllib

TASK: Final = "tictactoe"
LEARNER: Final = "player_1"
PLAY: Final[rllib.Options] = {"role": LEARNER, "others": {"player_2": "random"}, "flatten": True}
WANTED: Final = 0.85
"""Mean of +1 for a game won and -1 for one lost; who begins at random has about 0.3."""
GAMES: Final = 200
STEPS: Final = 30_000
"""Marks set while learning; 3 to 5 in a game."""


def config(seed: int) -> Any:
    """PPO in this process, with a module for the one role."""
    return (
        PPOConfig()
        .environment(rllib.register(TASK, seed=seed, **PLAY), disable_env_checking=True)
        .env_runners(num_env_runners=0, num_envs_per_env_runner=16)
        .multi_agent(**rllib.policy_mapping(TASK, **PLAY))
        .rl_module(
            rl_module_spec=rllib.modules(
                TASK, model_config=DefaultModelConfig(fcnet_hiddens=[64, 64]), **PLAY
            )
        )
        .training(
            lr=1e-3,
            train_batch_size_per_learner=2000,
            minibatch_size=250,
            num_epochs=6,
            entropy_coeff=0.01,
            gamma=0.99,
            lambda_=0.95,
        )
        .callbacks(rllib.ReturnsCallback)
        .debugging(seed=seed)
    )


def measured(learnt: Any, *, games: int, seed: int) -> float:
    """Mean return of whole games that no learning was done on."""
    evidence = gk.rollout(
        TASK, policies={"*": "random", LEARNER: learnt}, episodes=games, seed=seed
    )
    rows = evidence.agent_steps.to_pylist()
    return sum(row["reward"] or 0.0 for row in rows if row["agent"] == LEARNER) / games


def main() -> int:
    """Learns, measures, prints the line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a few steps, whatever they reach")
    asked = parser.parse_args()
    begun_s = time.monotonic()
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    algorithm = config(asked.seed).build_algo()
    steps, wanted_steps = 0, 2_000 if asked.quick else STEPS
    while steps < wanted_steps:
        result = algorithm.train()
        steps = int(result["env_runners"]["num_env_steps_sampled_lifetime"])
        returns = result["env_runners"]["gamekeeper"]["agent"]
        told = {agent: round(float(mean), 3) for agent, mean in returns.items()}
        print({"steps": steps, **told}, file=sys.stderr)
    learnt = rllib.policy(algorithm)
    reached = measured(learnt, games=20 if asked.quick else GAMES, seed=1_000_000 + asked.seed)
    algorithm.stop()
    ray.shutdown()
    is_reached = reached >= WANTED
    print(
        json.dumps(
            {
                "example": "rllib_tictactoe",
                "trainer": f"rllib {rllib.VERSION}",
                "task": TASK,
                "seed": asked.seed,
                "steps": steps,
                "seconds": round(time.monotonic() - begun_s, 1),
                "measure": "mean return of who begins, against random play",
                "result": round(reached, 3),
                "wanted": WANTED,
                "reached": is_reached,
            }
        )
    )
    return 0 if is_reached or asked.quick else 1


if __name__ == "__main__":
    sys.exit(main())
