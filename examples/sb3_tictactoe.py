"""MaskablePPO learns to begin a game of tic-tac-toe against one that plays by chance.

Needs `pip install 'gamekeeper[sb3,fast]'`. One side of 64 boards learns, the other one follows a
policy; whose turn it is, what is legal, and which action earned what came while the other moved is
the adapter's business (`sb3.vec_env`, `sb3.buffer`). The result is the mean of what it is paid (1
won, 0 drawn, -1 lost) in 200 games that nobody learnt from; chance against chance is paid 0.3.

    python examples/sb3_tictactoe.py [--seed 0] [--quick]

One JSON line; exit status 1 if the wanted result isn't reached.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any, Final

import gamekeeper as gk

TASK: Final = "tictactoe"
SIDE: Final = "player_1"
STEPS: Final = 150_000
"""Of all boards; in every second one it is the side's turn."""
QUICK: Final = 10_000
GAMES: Final = 200
WANTED: Final = 0.9
UNSEEN: Final = 1_000_000
"""Seed of the run that is judged."""


def learnt(seed: int, steps: int) -> Any:
    """A model that has played so many steps."""
    import torch
    from sb3_contrib import MaskablePPO

    from gamekeeper.adapters import sb3

    torch.set_num_threads(1)
    venv = sb3.vec_env(TASK, 64, role=SIDE, others="random", engine="kernel", seed=seed)
    model = MaskablePPO(
        "MlpPolicy",
        venv,
        n_steps=64,
        batch_size=256,
        n_epochs=6,
        gamma=1.0,
        gae_lambda=0.95,
        learning_rate=1e-3,
        ent_coef=0.01,
        device="cpu",
        seed=seed,
        **sb3.buffer(venv, masked=True),
    )
    model.learn(steps)
    venv.close()
    return model


def result(model: Any, games: int) -> float:
    """The mean of what the model is paid against chance."""
    from gamekeeper.adapters import sb3

    policies = {SIDE: sb3.policy(model), "*": "random"}
    played = gk.rollout(TASK, policies=policies, episodes=games, seed=UNSEEN)
    rows = played.agent_steps.group_by("agent").aggregate([("reward", "sum")]).to_pylist()
    return next(float(row["reward_sum"]) for row in rows if row["agent"] == SIDE) / games


def main() -> int:
    """Learns with one seed and prints what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a short run that shows that it runs")
    given = parser.parse_args()
    began_s = time.perf_counter()
    model = learnt(given.seed, QUICK if given.quick else STEPS)
    found = result(model, GAMES // 10 if given.quick else GAMES)
    import stable_baselines3

    print(
        json.dumps(
            {
                "example": "sb3_tictactoe",
                "trainer": f"stable-baselines3 {stable_baselines3.__version__}",
                "task": TASK,
                "seed": given.seed,
                "steps": model.num_timesteps,
                "seconds": round(time.perf_counter() - began_s, 1),
                "measure": "mean reward against chance",
                "result": round(found, 3),
                "wanted": WANTED,
                "reached": found >= WANTED,
            }
        )
    )
    return 0 if given.quick or found >= WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
