"""Trains the policies of benchmarks/learnt.py by SB3's PPO, and keeps them as arrays.

Each is shared by all agents and trained on normalized observations. Its network, as SB3 has it, and
the statistics that normalize are written into an .npz file; that its actions are those of the
model's `predict` is looked at on random observations.

    .venv-sb3/bin/python benchmarks/learnt_training.py [--frames 120000] [--out learnt]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

sys.path.insert(0, str(Path(__file__).parent))

from learnt_envs import Lanterns, Plots
from learnt_policies import Network

from gamekeeper.adapters import sb3

ENVS = {"plots": Plots, "lanterns": Lanterns}
SETTINGS = {"n_steps": 128, "batch_size": 512, "n_epochs": 8, "learning_rate": 1e-3, "gamma": 0.95}


def model_of(env: Any, frames: int) -> Any:
    """A model that learnt for so many agent-steps; 0: as it begins."""
    venv = sb3.normalized(sb3.vec_env(env, 8, check=None, seed=0), rewards=False)
    model = PPO("MlpPolicy", venv, device="cpu", seed=0, **SETTINGS, **sb3.buffer(venv))
    return model.learn(frames) if frames else model


def arrays(model: Any) -> dict[str, Any]:
    """Weights of the policy's network, by layer, and statistics of the observations."""
    layers = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    layers = [layer for layer in layers if isinstance(layer, torch.nn.Linear)]
    found = {}
    for number, layer in enumerate(layers):
        found[f"weight_{number}"] = layer.weight.detach().numpy()
        found[f"bias_{number}"] = layer.bias.detach().numpy()
    statistics = model.get_vec_normalize_env().obs_rms
    return {**found, "mean": statistics.mean, "variance": statistics.var}


def compare(model: Any, kept: Any) -> float:
    """Largest difference between actions of the arrays and of `predict`, on 500 observations."""
    space, policy = model.observation_space, Network(kept)
    rows = np.random.default_rng(0).uniform(space.low, space.high, (500, *space.shape))
    seen = model.get_vec_normalize_env()
    off = 0.0
    for row in rows.astype(np.float32):
        action, _ = model.predict(seen.normalize_obs(row), deterministic=True)
        own = policy.act(row, model.action_space)
        off = max(off, float(np.abs(np.asarray(action, np.float64) - own).max()))
    return off


def main() -> None:
    """Trains both, and keeps what hasn't learnt beside them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=120_000)
    parser.add_argument("--out", type=Path, default=Path("learnt"))
    parser.add_argument("--envs", nargs="+", choices=ENVS, default=list(ENVS))
    options = parser.parse_args()
    torch.set_num_threads(1)
    options.out.mkdir(exist_ok=True)
    for name in options.envs:
        for kind, frames in (("learnt", options.frames), ("untrained", 0)):
            began = time.process_time()
            model = model_of(ENVS[name], frames)
            kept = arrays(model)
            if not frames:  # the statistics of the others: only weights are left out
                learnt = np.load(options.out / f"{name}-learnt.npz")
                kept |= {key: learnt[key] for key in ("mean", "variance")}
            np.savez(options.out / f"{name}-{kind}.npz", **kept)
            off = compare(model, kept) if frames else None
            row = {"env": name, "kind": kind, "frames": frames, "largest difference": off}
            print(json.dumps({**row, "cpu_s": round(time.process_time() - began)}), flush=True)


if __name__ == "__main__":
    main()
