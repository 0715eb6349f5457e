"""Robots of the warehouse learn with a critic that sees everything: MAPPO over compiled copies.

Needs torch (`pip install 'gamekeeper[fast]' torch`); one thread, no GPU:

    python examples/mappo_warehouse.py --seed 0

One network acts for all robots and sees what a robot sees; another one, the critic, is given
`state()` beside that, and is needed only while they learn. Actions that aren't available have
probability 0. What is worth a look:

    - `batch.play()` leaves a copy that is over where it ended, so that `batch.overview()` is the
      state at the end, and the critic says what a robot that the horizon cut off would have had.
      `batch.restart()` begins the next episodes.
    - A robot that ran empty while the others play on gets nothing more: it learns to recharge.
      Its place counts for nothing until its copy begins anew.
    - What robots learn from are weighted terms of the reward; they are judged by deliveries.

Half-way everything is saved, and a new learner goes on from the file. The last line is JSON:
deliveries per episode of four, over episodes that nobody learnt from, with an interval; some are
recorded and replayed.

Source: Yu et al. 2022, "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games" (one
network for all, state and own observation for the critic, values in running units, few epochs);
Schulman et al. 2017 (clipping) and 2016 (generalised advantages).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

import gamekeeper as gk
from gamekeeper.kernels.batch import Batch
from gamekeeper.statistics.one_sample import one_sample

TASK: Final = "warehouse"
KWARGS: Final = {"pickers": 2, "carriers": 1, "spares": 0, "orders": 4}
WEIGHTS: Final = {"delivery": 2.0, "grasp": 5.0, "collision": 0.4}
"""Of terms while learning, 1 of others: from the plain sum robots learn to stand still first,
because moving costs at once and what it earns comes late."""
WANTED: Final = 3.8
"""Deliveries per episode."""
UNSEEN: Final = 1_000_000
"""The run whose episodes judge; those that are learnt from belong to other runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Args:
    """What a run depends on, beside its seed."""

    copies: int = 256
    length: int = 32
    """Steps of every copy between two updates."""
    updates: int = 60
    epochs: int = 4
    minibatch: int = 4_096
    rate: float = 1.5e-3
    """Of learning; falls to zero in a straight line."""
    discount: float = 0.98
    trace: float = 0.95
    clip: float = 0.2
    entropy: float = 0.01
    hidden: int = 64
    sees_state: bool = True
    """Whether the critic does; else it sees what a robot sees."""
    judged: int = 500
    """Episodes that judge."""


class Scale:
    """Brings numbers to running units: standard deviations from their mean so far."""

    def __init__(self, size: int) -> None:
        self.count, self.mean, self.square = 1e-4, torch.zeros(size), torch.ones(size)

    def note(self, rows: torch.Tensor) -> None:
        """Goes on over [rows, size]. Source: Chan, Golub, LeVeque 1979 (updating in parts)."""
        apart, total = rows.mean(0) - self.mean, self.count + len(rows)
        mass = self.square * self.count + rows.var(0, unbiased=False) * len(rows)
        self.square = (mass + apart**2 * self.count * len(rows) / total) / total
        self.mean, self.count = self.mean + apart * len(rows) / total, total

    def state_dict(self) -> dict[str, Any]:
        """Returns what was noted."""
        return dict(vars(self))

    def load_state_dict(self, saved: dict[str, Any]) -> None:
        """Goes on from what was noted."""
        vars(self).update(saved)

    @property
    def deviation(self) -> torch.Tensor:
        """1e-2 at least, for what hardly ever changes."""
        return self.square.sqrt().clamp(min=1e-2)

    def of(self, numbers: torch.Tensor) -> torch.Tensor:
        """In running units; beyond five of them it makes no difference."""
        return ((numbers - self.mean) / self.deviation).clamp(-5, 5)


def net(inputs: int, hidden: int, outputs: int, gain: float) -> nn.Sequential:
    """Two hidden layers; orthogonal weights to begin with, the last ones as large as `gain`."""
    layers = [nn.Linear(inputs, hidden), nn.Linear(hidden, hidden), nn.Linear(hidden, outputs)]
    for layer, size in zip(layers, (2**0.5, 2**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, size)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])


class Robots:
    """The network that acts; for all robots, which know their role from what they see."""

    def __init__(self, seen: int, actions: int, hidden: int) -> None:
        self.actor, self.scale = net(seen, hidden, actions, 0.01), Scale(seen)

    def chance(self, seen: torch.Tensor, masks: torch.Tensor) -> Categorical:
        """Over actions; `seen` in running units."""
        return Categorical(logits=self.actor(seen).masked_fill(masks == 0, -1e9))

    def act(self, batch: Batch) -> np.ndarray:
        """Actions drawn for all places; where nobody is, any will do."""
        a = batch.arrays
        masks = torch.from_numpy(np.where(a.live[..., None], a.masks, 1))
        with torch.no_grad():
            seen = self.scale.of(torch.from_numpy(a.obs).float())
            return self.chance(seen, masks).sample().numpy()


class Mappo:
    """Plays copies, and learns from what came of it."""

    def __init__(self, args: Args, seed: int) -> None:
        torch.manual_seed(seed)
        self.args, kernel = args, gk.make(TASK, **KWARGS).kernel
        self.batch = Batch(kernel, args.copies, seed=seed)
        self.batch.reset()
        a = self.batch.arrays
        seen, actions = a.obs.shape[-1], a.masks.shape[-1]
        whole = self.batch.overview().shape[-1]
        self.robots = Robots(seen, actions, args.hidden)
        self.critic, self.state_scale = net(whole + seen, args.hidden, 1, 1.0), Scale(whole)
        self.value_scale = Scale(1)
        weights = [*self.robots.actor.parameters(), *self.critic.parameters()]
        self.optimizer = torch.optim.Adam(weights, lr=args.rate, eps=1e-5)
        self.weights = torch.tensor([WEIGHTS.get(term, 1.0) for term in kernel.terms])
        self.steps = 0

    @property
    def parts(self) -> dict[str, Any]:
        """Everything that learning changes, but for the warehouses."""
        scales = self.robots.scale, self.state_scale, self.value_scale
        return {
            "actor": self.robots.actor,
            "critic": self.critic,
            "optimizer": self.optimizer,
            **{f"scale {number}": scale for number, scale in enumerate(scales)},
        }

    def save(self, file: Path) -> Path:
        """Writes it."""
        torch.save({name: part.state_dict() for name, part in self.parts.items()}, file)
        return file

    def load(self, file: Path) -> None:
        """Goes on from a file, in fresh warehouses."""
        for name, saved in torch.load(file).items():
            self.parts[name].load_state_dict(saved)

    def look(self, note: bool) -> tuple[torch.Tensor, torch.Tensor]:
        """What robots see, and what the critic is given: [copy, robot, ...] in running units."""
        seen = torch.from_numpy(self.batch.arrays.obs).float()
        states = torch.from_numpy(self.batch.overview()).float()
        if note:
            self.robots.scale.note(seen[torch.from_numpy(self.batch.arrays.live)])
            self.state_scale.note(states)
        own, whole = self.robots.scale.of(seen), self.state_scale.of(states)
        if not self.args.sees_state:
            whole = torch.zeros_like(whole)
        return own, torch.cat((whole[:, None].expand(-1, own.shape[1], -1), own), -1)

    def values(self, given: torch.Tensor) -> torch.Tensor:
        """What the critic expects, in units of the reward."""
        found = self.critic(given).squeeze(-1)
        return found * self.value_scale.deviation + self.value_scale.mean

    @torch.no_grad()
    def play(self) -> tuple[torch.Tensor, ...]:
        """So many steps of all copies; [step, copy, robot, ...]."""
        args, batch, a, rows = self.args, self.batch, self.batch.arrays, []
        own, given = self.look(note=True)
        for step in range(args.length):
            live = torch.from_numpy(a.live.copy())
            masks = torch.from_numpy(np.where(a.live[..., None], a.masks, 1))
            chance = self.robots.chance(own, masks)
            actions, values = chance.sample(), self.values(given)
            a.actions[...] = actions.numpy()
            batch.play()
            paid = torch.from_numpy(a.terms).float() @ self.weights
            cut = torch.from_numpy(a.truncated & a.ended[:, None]) & live
            ends = torch.from_numpy(a.terminated | a.truncated)
            if cut.any():  # by the horizon: what would have followed is estimated
                paid += args.discount * torch.where(cut, self.values(self.look(note=False)[1]), 0.0)
            rows.append(
                (
                    own,
                    given,
                    masks,
                    live,
                    actions,
                    chance.log_prob(actions),
                    values,
                    paid,
                    live & ~ends,
                )
            )
            batch.restart()
            own, given = self.look(note=step % 8 == 7)
        self.steps += int(sum(row[3].sum() for row in rows))
        return (*(torch.stack(column) for column in zip(*rows, strict=True)), self.values(given))

    def learn(self) -> None:
        """Plays, then passes a few times over the steps at whose beginning a robot was there."""
        args = self.args
        own, given, masks, live, actions, likely, values, paid, goes_on, after = self.play()
        better, ahead = torch.zeros_like(values), torch.zeros(())
        for t in reversed(range(args.length)):
            on = args.discount * goes_on[t]
            ahead = paid[t] + on * after - values[t] + args.trace * on * ahead
            better[t], after = ahead, values[t]
        returns = (better + values)[live]
        self.value_scale.note(returns[:, None])
        returns = (returns - self.value_scale.mean) / self.value_scale.deviation
        better = better[live]
        better = (better - better.mean()) / (better.std() + 1e-8)
        own, given, masks = own[live], given[live], masks[live]
        actions, likely = actions[live], likely[live]
        for _ in range(args.epochs):
            for rows in torch.randperm(len(own)).split(args.minibatch):
                chance = self.robots.chance(own[rows], masks[rows])
                ratio = (chance.log_prob(actions[rows]) - likely[rows]).exp()
                held = ratio.clamp(1 - args.clip, 1 + args.clip)
                gain = torch.minimum(ratio * better[rows], held * better[rows]).mean()
                miss = nn.functional.huber_loss(self.critic(given[rows]).squeeze(-1), returns[rows])
                self.optimizer.zero_grad()
                (miss - gain - args.entropy * chance.entropy().mean()).backward()
                nn.utils.clip_grad_norm_(self.optimizer.param_groups[0]["params"], 0.5)
                self.optimizer.step()

    def run(self, updates: range) -> None:
        """Some of all updates; says on stderr how it goes."""
        for update in updates:
            self.optimizer.param_groups[0]["lr"] = self.args.rate * (1 - update / self.args.updates)
            self.learn()
            if update % 10 == 9:
                found = deliveries(self.robots, 64, seed=1).mean()
                sys.stderr.write(f"{self.steps} steps: {found:.2f} deliveries\n")


def policy(robots: Robots) -> Callable[..., int]:
    """Returns a policy that draws actions as robots do while they are judged."""

    def act(observation: Any, agent: Any, info: Any, rng: Any) -> int:
        seen = torch.from_numpy(np.asarray(observation, np.float32))
        mask = torch.from_numpy(np.asarray(info["action_mask"]))
        with torch.no_grad():
            chances = robots.chance(robots.scale.of(seen), mask).probs.numpy()
        return int(np.searchsorted(np.cumsum(chances[:-1]), rng.random()))

    return act


def is_replayed(robots: Robots, episodes: int, out: Path) -> bool:
    """Records some episodes as `gk.rollout` plays them, and tells whether they replay."""
    gk.rollout(
        TASK, policies=policy(robots), episodes=episodes, seed=UNSEEN, out=out, env_kwargs=KWARGS
    )
    return bool(gk.replay(out).verified)


def deliveries(robots: Robots, episodes: int, seed: int) -> np.ndarray:
    """How many items each of so many episodes brought to a dock."""
    kernel = gk.make(TASK, **KWARGS).kernel
    batch = Batch(kernel, episodes, seed=seed)
    batch.reset()
    a, term = batch.arrays, list(kernel.terms).index("delivery")
    found, over = np.zeros(episodes), np.zeros(episodes, bool)
    while not over.all():
        batch.step(robots.act(batch))
        found += np.where(over, 0.0, a.terms[..., term].max(1))  # all are paid for one delivery
        over |= a.ended
    return found


def main() -> int:
    """Learns, is judged, and prints one JSON line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a few steps, to see that it runs")
    parser.add_argument("--own", action="store_true", help="a critic that doesn't see the state")
    options = parser.parse_args()
    torch.set_num_threads(1)
    args = Args(sees_state=not options.own)
    if options.quick:
        args = replace(args, copies=16, length=16, updates=3, judged=8)
    begun, busy = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as name:
        file, middle, steps = Path(name) / "learner.pt", args.updates // 2, 0
        for number, part in enumerate((range(middle), range(middle, args.updates))):
            learner = Mappo(args, options.seed + number * 1_000)
            if number:
                learner.load(file)
            learner.run(part)
            learner.save(file)
            steps += learner.steps
        learner = Mappo(args, 0)
        learner.load(file)
        seconds, spent = time.perf_counter() - begun, time.process_time() - busy
        found = deliveries(learner.robots, args.judged, UNSEEN)
        replays = is_replayed(learner.robots, 2 if options.quick else 20, Path(name) / "run")
    shown = None if options.quick else one_sample(found, rng=np.random.default_rng(0))
    reached = bool(found.mean() >= WANTED)
    print(
        json.dumps(
            {
                "example": "mappo_warehouse",
                "trainer": f"torch {torch.__version__}",
                "task": TASK,
                "seed": options.seed,
                "critic": "state" if args.sees_state else "own",
                "steps": steps,
                "seconds": round(seconds, 1),
                "cpu_s": round(spent, 1),
                "measure": f"deliveries of {KWARGS['orders']}, {args.judged} episodes",
                "result": round(float(found.mean()), 3),
                "interval": shown and [round(shown.low, 3), round(shown.high, 3)],
                "replayed": replays,
                "wanted": WANTED,
                "reached": reached,
            }
        )
    )
    return 0 if replays and (reached or options.quick) else 1


if __name__ == "__main__":
    sys.exit(main())
