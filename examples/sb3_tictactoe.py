"""MaskablePPO learns to begin a game of tic-tac-toe against one that plays by chance.

Needs `pip install 'gamekeeper[sb3,fast]'`. One side of 64 boards learns, the other one follows a
policy; whose turn it is, what is legal, and which action earned what came while the other moved is
the adapter's business (`sb3.vec_env`, `sb3.buffer`). Half-way the model is saved, and goes on to
learn from its file; out of the last file it plays games that are recorded and replayed. The result
is the mean of what it is paid (1 won, 0 drawn, -1 lost) in 200 games that nobody learnt from;
chance against chance is paid 0.3.

    python examples/sb3_tictactoe.py [--seed 0] [--quick]

One JSON line; exit status 1 if the wanted result isn't reached.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

import gamekeeper as gk
from gamekeeper.statistics.one_sample import one_sample

TASK: Final = "tictactoe"
SIDE: Final = "player_1"
STEPS: Final = 150_000
"""Of all boards; in every second one it is the side's turn."""
QUICK: Final = 10_000
GAMES: Final = 200
WANTED: Final = 0.9
UNSEEN: Final = 1_000_000
"""Seed of the run that is judged."""


def boards(seed: int) -> Any:
    """64 boards, one side of which learns."""
    from gamekeeper.adapters import sb3

    return sb3.vec_env(TASK, 64, role=SIDE, others="random", engine="kernel", seed=seed)


def learnt(seed: int, steps: int, folder: Path) -> Path:
    """Learns in two halves, with a file in between; returns the file of the model."""
    import torch
    from sb3_contrib import MaskablePPO

    from gamekeeper.adapters import sb3

    torch.set_num_threads(1)
    venv = boards(seed)
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
    model.learn(steps // 2)
    file = sb3.save(model, folder / "half")
    venv.close()

    venv = boards(seed + 1_000)
    model = MaskablePPO.load(file, env=venv, device="cpu", **sb3.buffer(venv, masked=True))
    model.learn(steps - steps // 2, reset_num_timesteps=False)
    venv.close()
    return sb3.save(model, folder / "whole")


def results(file: Path, games: int, out: Path) -> list[float]:
    """Rewards of a saved model against chance, game by game; the games are recorded."""
    policies = {SIDE: f"sb3:{file}", "*": "random"}
    played = gk.rollout(TASK, policies=policies, episodes=games, seed=UNSEEN, out=out)
    paid = [0.0] * games
    for row in played.agent_steps.to_pylist():
        paid[row["episode"]] += (row["reward"] or 0.0) if row["agent"] == SIDE else 0.0
    return paid


def main() -> int:
    """Learns with one seed and prints what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a short run that shows that it runs")
    given = parser.parse_args()
    began_s, steps = time.perf_counter(), QUICK if given.quick else STEPS
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = learnt(given.seed, steps, folder)
        paid = results(file, GAMES // 2 if given.quick else GAMES, folder / "run")
        is_replayed = gk.replay(folder / "run").verified
    found = float(np.mean(paid))
    shown = one_sample(paid, rng=np.random.default_rng(0))
    import stable_baselines3

    print(
        json.dumps(
            {
                "example": "sb3_tictactoe",
                "trainer": f"stable-baselines3 {stable_baselines3.__version__}",
                "task": TASK,
                "seed": given.seed,
                "steps": steps,
                "seconds": round(time.perf_counter() - began_s, 1),
                "measure": "mean reward against chance",
                "result": round(found, 3),
                "interval": [round(shown.low, 3), round(shown.high, 3)],
                "replayed": is_replayed,
                "wanted": WANTED,
                "reached": found >= WANTED,
            }
        )
    )
    return 0 if is_replayed and (given.quick or found >= WANTED) else 1


if __name__ == "__main__":
    sys.exit(main())
