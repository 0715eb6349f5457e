"""Agents learn to spread out over landmarks: PPO from TorchRL's parts over compiled copies.

    python examples/torchrl_spread.py --seed 0

Needs TorchRL (`pip install 'gamekeeper[torchrl,fast]'`). Prints one line of JSON; exits with 1 if
what was learnt isn't good enough. The copies are one TorchRL environment, the collector, the actor
and the loss are TorchRL's own; `advantages` and `decisions` see to it that everybody learns from
its own decisions alone, so the same lines learn tasks in which agents die, wait or join late.

Source: Schulman et al. 2017, "Proximal Policy Optimization Algorithms"; parameters shared by all
agents of a group, as in Yu et al. 2022, "The Surprising Effectiveness of PPO".
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
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

TASK: Final = "spread"
WANTED: Final = -21.5
"""An agent's mean return; random play gets -27.9 of the same seeds, the reference policy -8.8."""
COPIES: Final = 64
STEPS: Final = 320_000
"""Of all copies together."""
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
        adapter.advantages(batch, self.env.group_map, gamma=GAMMA, trace=TRACE)
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


def main(arguments: list[str] | None = None) -> int:
    """Learns, plays 50 episodes, says what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a few steps, whatever comes of it")
    parser.add_argument("--check", default="quick", help="none: no audit before training")
    asked = parser.parse_args(arguments)
    torch.set_num_threads(1)
    torch.manual_seed(asked.seed)
    steps = 3_200 if asked.quick else STEPS
    began_s = time.perf_counter()
    env = adapter.env(
        TASK,
        COPIES,
        engine="kernel",
        masks=True,
        flatten=True,
        seed=asked.seed,
        check=None if asked.check == "none" else asked.check,
    )
    learner = Learner(env)
    for number, batch in enumerate(learner.batches(frames=COPIES * 25, total=steps)):
        rate = RATE * (1 - number * COPIES * 25 / steps)
        for group in learner.optimiser.param_groups:
            group["lr"] = rate
        paid = learner.learn(batch)
        if number % 20 == 0:
            print(f"{number * COPIES * 25:>8} steps, {25 * paid:7.2f} an episode", file=sys.stderr)
    env.close()
    policy = adapter.policy(learner.actor, env)
    evidence = gk.rollout(TASK, policies=policy, episodes=4 if asked.quick else 50, seed=1_000)
    rewards = evidence.agent_steps.group_by(["episode", "agent"]).aggregate([("reward", "sum")])
    result = float(np.mean(rewards["reward_sum"].to_numpy()))
    print(
        json.dumps(
            {
                "example": "torchrl_spread",
                "trainer": f"torchrl {adapter.VERSION}",
                "task": TASK,
                "seed": asked.seed,
                "steps": steps,
                "seconds": round(time.perf_counter() - began_s, 1),
                "measure": "an agent's mean return over 50 episodes",
                "result": round(result, 2),
                "wanted": WANTED,
                "reached": result >= WANTED,
            }
        )
    )
    return 0 if asked.quick or result >= WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
