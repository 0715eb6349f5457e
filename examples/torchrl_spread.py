"""Agents learn to spread out over landmarks: PPO from TorchRL's parts over compiled copies.

    python examples/torchrl_spread.py --seed 0

Needs TorchRL (`pip install 'gamekeeper[torchrl,fast]'`). Prints one line of JSON; exits with 1 if
what was learnt isn't good enough. The copies are one TorchRL environment, the collector, the actor
and the loss are TorchRL's own; `advantages` and `decisions` see to it that everybody learns from
its own decisions alone, so the same lines learn tasks in which agents die, wait or join late.
Half-way everything is saved, and goes on in a learner that is read from the file; out of the last
file 100 episodes are played, recorded and replayed.

Source: Schulman et al. 2017, "Proximal Policy Optimization Algorithms"; parameters shared by all
agents of a group, as in Yu et al. 2022, "The Surprising Effectiveness of PPO".
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import nn
from torchrl.collectors import Collector
from torchrl.modules import MaskedCategorical, ProbabilisticActor
from torchrl.objectives import ClipPPOLoss

import gamekeeper as gk
from gamekeeper.adapters import torchrl as adapter
from gamekeeper.statistics.one_sample import one_sample

TASK: Final = "spread"
WANTED: Final = -21.5
"""An agent's mean return; random play gets -27.9 of the same seeds, the reference policy -8.8."""
COPIES: Final = 64
STEPS: Final = 320_000
"""Of all copies together."""
EPISODES: Final = 100
"""That judge; an interval of a mean needs 95."""
GAMMA, TRACE, CLIP, ENTROPY, RATE = 0.95, 0.9, 0.2, 0.01, 1e-3
EPOCHS, MINIBATCH = 4, 1_200


def network(inputs: int, outputs: int) -> nn.Module:
    """Two layers of 64."""
    return nn.Sequential(
        nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)
    )


class Learner:
    """PPO with one actor and one critic for each group, shared by its agents.

    Args:
        env: made with `masks=True, flatten=True`, so that every group has the same keys.
    """

    def __init__(self, env: Any, *, rate: float = RATE) -> None:
        self.env, self.losses, actors = env, {}, []
        self.critics = {}
        for group in env.group_map:
            inputs = env.observation_spec[group, "observation"].shape[-1]
            actions = env.observation_spec[group, "action_mask"].shape[-1]
            policy, value = network(inputs, actions), network(inputs, 1)
            actors.append(self._actor(policy, (group,)))
            self.critics[group] = value
            critic = TensorDictModule(value, in_keys=["observation"], out_keys=["state_value"])
            self.losses[group] = ClipPPOLoss(
                self._actor(policy, ()), critic, clip_epsilon=CLIP, entropy_coeff=ENTROPY
            )
        self.actor = TensorDictSequential(*actors)
        parameters = [p for loss in self.losses.values() for p in loss.parameters()]
        self.optimiser = torch.optim.Adam(parameters, lr=rate)

    def save(self, file: Path) -> Path:
        """Writes networks and optimizer."""
        losses = {group: loss.state_dict() for group, loss in self.losses.items()}
        torch.save({"losses": losses, "optimiser": self.optimiser.state_dict()}, file)
        return file

    def load(self, file: Path) -> None:
        """Goes on from a file."""
        saved = torch.load(file)
        for group, weights in saved["losses"].items():
            self.losses[group].load_state_dict(weights)
        self.optimiser.load_state_dict(saved["optimiser"])

    def _actor(self, policy: nn.Module, at: tuple[str, ...]) -> Any:
        """The same network where a group is nested, and over rows of decisions."""
        logits = TensorDictModule(policy, [(*at, "observation")], [(*at, "logits")])
        return ProbabilisticActor(
            logits,
            in_keys={"logits": (*at, "logits"), "mask": (*at, "action_mask")},
            out_keys=[(*at, "action")],
            distribution_class=MaskedCategorical,
            return_log_prob=True,
            log_prob_key=(*at, "action_log_prob"),
        )

    def batches(self, *, frames: int, total: int) -> Iterator[Any]:
        """What TorchRL's collector collects, [copy, step]."""
        collector = Collector(
            self.env,
            self.actor,
            frames_per_batch=frames,
            total_frames=total,
            auto_register_policy_transforms=False,
        )
        try:
            yield from collector
        finally:
            collector.shutdown(close_env=False)

    def learn(self, batch: Any) -> float:
        """An update from one batch; returns the mean reward of an agent's step."""
        with torch.no_grad():
            for group, critic in self.critics.items():
                for when in (batch, batch["next"]):
                    when[group, "state_value"] = critic(when[group, "observation"])
        adapter.advantages(batch, self.env.group_map, gamma=GAMMA, gae_lambda=TRACE)
        rows = {group: adapter.decisions(batch, group) for group in self.losses}
        for _ in range(EPOCHS):
            for group, loss in self.losses.items():
                for part in torch.randperm(len(rows[group])).split(MINIBATCH):
                    found = loss(rows[group][part])
                    total = sum(found[key] for key in found.keys() if key.startswith("loss_"))  # noqa: SIM118  # a TensorDict
                    self.optimiser.zero_grad()
                    total.backward()
                    nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                    self.optimiser.step()
        paid = [batch["next", group, "reward"].mean() for group in self.losses]
        return float(torch.stack(paid).mean())


def sub_environments(count: int, seed: int, check: str | None) -> Any:
    """They, as one TorchRL environment."""
    return adapter.env(
        TASK, count, engine="kernel", masks=True, flatten=True, seed=seed, check=check
    )


def half(learner: Learner, steps: range, total: int) -> None:
    """Learns from the first of these steps to the last."""
    batches = learner.batches(frames=steps.step, total=len(steps) * steps.step)
    for number, batch in enumerate(batches):
        for group in learner.optimiser.param_groups:
            group["lr"] = RATE * (1 - steps[number] / total)
        paid = learner.learn(batch)
        if number % 20 == 0:
            print(f"{steps[number]:>8} steps, {25 * paid:7.2f} an episode", file=sys.stderr)


def learn(seed: int, steps: int, folder: Path, check: str | None) -> Path:
    """Learns in two halves, the second by a learner that was read from the first one's file."""
    file, each = folder / "learner.pt", COPIES * 25
    middle = steps // each // 2 * each
    for number, part in enumerate((range(0, middle, each), range(middle, steps, each))):
        env = sub_environments(COPIES, seed + number * 1_000, check)
        learner = Learner(env)
        if number:
            learner.load(file)
        half(learner, part, steps)
        learner.save(file)
        env.close()
    return file


def judge(file: Path, episodes: int, out: Path) -> Any:
    """An agent's mean return in each of some recorded episodes of a saved learner."""
    env = sub_environments(1, 0, None)
    learner = Learner(env)
    learner.load(file)
    policy = adapter.policy(learner.actor, env)
    evidence = gk.rollout(TASK, policies=policy, episodes=episodes, seed=1_000, out=out)
    env.close()
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
    torch.manual_seed(asked.seed)
    steps = 3_200 if asked.quick else STEPS
    began_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = learn(asked.seed, steps, folder, None if asked.check == "none" else asked.check)
        found = judge(file, 4 if asked.quick else EPISODES, folder / "run")
        is_replayed = gk.replay(folder / "run").verified
    result = float(np.mean(found))
    shown = None if asked.quick else one_sample(found, rng=np.random.default_rng(0))
    print(
        json.dumps(
            {
                "example": "torchrl_spread",
                "trainer": f"torchrl {adapter.VERSION}",
                "task": TASK,
                "seed": asked.seed,
                "steps": steps,
                "seconds": round(time.perf_counter() - began_s, 1),
                "measure": f"an agent's mean return over {EPISODES} episodes",
                "result": round(result, 2),
                "interval": shown and [round(shown.low, 2), round(shown.high, 2)],
                "replayed": is_replayed,
                "wanted": WANTED,
                "reached": result >= WANTED,
            }
        )
    )
    return 0 if is_replayed and (asked.quick or result >= WANTED) else 1


if __name__ == "__main__":
    sys.exit(main())
