"""One network learns to play every robot of the warehouse: PPO over a batch of compiled copies.

Needs torch for learning (`pip install 'gamekeeper[fast]' torch`), and nothing but Gamekeeper for
playing what was learnt:

    python examples/ppo_warehouse.py --seeds 0 1 2 --out runs/ppo
    gamekeeper rollout warehouse --policy examples/ppo_warehouse.py:Robots --episodes 20 --out
    runs/p

The second command plays the weights named by PPO_WAREHOUSE, or the file beside this one.

What it shows of a batch of copies (`kernel.batch`):
    - All arrays are [copy, robot, ...]. Every step overwrites them, so what is kept is copied.
    - A robot that ran empty has ended alone; its place stays dead until a spare joins or the copy
      begins anew. Places count only for steps at whose beginning a robot was `live` there.
    - Who was terminated, or ran empty while the others play on, gets nothing more: what follows is
      worth 0, and a robot learns to recharge. (The contract calls an empty battery a truncation,
      as the task isn't over; but no clock cut it off.) At the horizon the episode is cut: what
      would have followed is estimated from what a robot saw last, which stands in `final`, as
      `obs` shows the next episode already.
    - What is masked out gets probability 0.

Source: Schulman et al. 2017, "Proximal Policy Optimization Algorithms"; Schulman et al. 2016
(generalised advantages); one network for all agents, which know their role from what they see, as
Gupta et al. 2017 and Yu et al. 2022 ("The Surprising Effectiveness of PPO") do.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import gamekeeper as gk
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.kernel import Kernel

LEARNT: Final = Path(__file__).with_suffix(".npz")
SMALL: Final = {"pickers": 2, "carriers": 1, "spares": 0, "orders": 4}
"""A warehouse that is learnt in minutes."""
WEIGHTS: Final = {"delivery": 2.0, "grasp": 5.0, "collision": 0.4}
"""What robots learn from; they are judged by the reward itself."""
FAR: Final = 5.0
"""Standard deviations beyond which what is seen makes no difference."""

Array = NDArray[Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What a run depends on, beside its seed.

    Attributes:
        env: what is learnt, one of Gamekeeper's tasks.
        env_kwargs: its arguments.
        weights: of terms of the reward, while learning; 1 of those that aren't named. From the sum
            itself robots that know nothing yet learn to stand still: moving costs them at once, and
            what it earns comes late and to all.
        copies: played at once.
        length: steps of every copy between two updates.
        steps: of all robots together, after which learning is over.
        epochs: how often an update sees each step.
        minibatch: steps of robots in a step of gradient descent.
        rate: of learning; it falls to zero in a straight line.
        discount, trace: gamma and lambda of the advantages.
        clip: how far a ratio of probabilities may go.
        entropy: what staying undecided is worth.
        hidden: units in each of the two layers.
    """

    env: str = "warehouse"
    env_kwargs: Mapping[str, Any] = field(default_factory=lambda: dict(SMALL))
    weights: Mapping[str, float] = field(default_factory=lambda: dict(WEIGHTS))
    copies: int = 256
    length: int = 32
    steps: int = 2_000_000
    epochs: int = 3
    minibatch: int = 4_096
    rate: float = 1e-3
    discount: float = 0.98
    trace: float = 0.95
    clip: float = 0.2
    entropy: float = 0.01
    hidden: int = 64


# What plays: plain NumPy.


class Robots:
    """A policy for all robots: draws an action from what the network gives for what a robot sees.

    Args:
        path: of the weights; None: PPO_WAREHOUSE, or the file beside this one.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        path = Path(path or os.environ.get("PPO_WAREHOUSE") or LEARNT)
        with np.load(path) as file:
            self.weights = {name: file[name] for name in file.files}
        self.version = hashlib.blake2b(path.read_bytes(), digest_size=8).hexdigest()

    def __call__(self, observation: Any, agent: str, info: Any, rng: np.random.Generator) -> int:
        """An action that isn't masked out."""
        w = self.weights
        x = np.clip((observation - w["mean"]) / w["deviation"], -FAR, FAR)
        for layer in ("0", "2"):
            x = np.tanh(w[f"actor.{layer}.weight"] @ x + w[f"actor.{layer}.bias"])
        logits = w["actor.4.weight"] @ x + w["actor.4.bias"]
        likely = np.where(info["action_mask"] != 0, np.exp(logits - logits.max()), 0.0)
        return int(np.searchsorted(np.cumsum(likely), rng.random() * likely.sum(), side="right"))


# What learns: torch.


@dataclass(frozen=True, slots=True)
class Steps:
    """What all places of all copies went through between two updates; [step, copy, robot, ...].

    Attributes:
        seen, masks: what a robot was given.
        live: whether one was there.
        actions, likely: what it did, and the logarithm of how likely that was.
        values: what the network expected.
        rewards: paid, terms weighted, and beyond a cut what was expected.
        goes_on: whether the robot lived on.
        after: [copy, robot], what the network expects after the last step.
    """

    seen: Any
    masks: Any
    live: Any
    actions: Any
    likely: Any
    values: Any
    rewards: Any
    goes_on: Any
    after: Any


class Learner:
    """Plays a batch of copies and learns from it.

    Args:
        kernel: the rules; all agents share their spaces.
        settings: see there.
        seed: of the episodes, the network's first weights and the actions that are drawn.
    """

    def __init__(self, kernel: Kernel, settings: Settings, seed: int) -> None:
        import torch

        self.torch, self.settings = torch, settings
        torch.manual_seed(seed)
        self.batch = Batch(kernel, settings.copies, seed=seed)
        self.batch.reset()
        arrays = self.batch.arrays
        self.length, self.actions = arrays.obs.shape[-1], arrays.masks.shape[-1]
        self.nets = torch.nn.ModuleDict(
            {"actor": self._net(self.actions, 0.01), "critic": self._net(1, 1.0)}
        )
        # The same memory as the batch's: every step shows here without a copy.
        self.obs, self.masks = torch.from_dlpack(arrays.obs), torch.from_dlpack(arrays.masks)
        self.weights = torch.tensor([settings.weights.get(term, 1.0) for term in kernel.terms])
        self.played = 0
        self.count, self.mean = 1e-4, torch.zeros(self.length)
        self.square = torch.ones(self.length)

    def _net(self, outputs: int, gain: float) -> Any:
        nn, hidden = self.torch.nn, self.settings.hidden
        layers = [nn.Linear(self.length, hidden), nn.Linear(hidden, hidden)]
        layers.append(nn.Linear(hidden, outputs))
        for layer, size in zip(layers, (2**0.5, 2**0.5, gain), strict=True):
            nn.init.orthogonal_(layer.weight, size)
            nn.init.zeros_(layer.bias)
        return nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])

    def deviation(self) -> Any:
        """Of each number that is seen, 1e-2 at least."""
        return self.square.sqrt().clamp(min=1e-2)

    def scaled(self, seen: Any) -> Any:
        """What is seen, in standard deviations from what was seen so far."""
        return ((seen - self.mean) / self.deviation()).clamp(-FAR, FAR)

    def note(self, seen: Any) -> None:
        """Mean and variance go on over what was just seen, [rows, numbers].

        Source: Chan, Golub, LeVeque 1979 (updating in parts).
        """
        rows = len(seen)
        if not rows:
            return
        apart, total = seen.mean(0) - self.mean, self.count + rows
        mass = self.square * self.count + seen.var(0, unbiased=False) * rows
        self.square = (mass + apart**2 * self.count * rows / total) / total
        self.mean = self.mean + apart * rows / total
        self.count = total

    def logits(self, seen: Any, masks: Any) -> Any:
        """Logarithms of what each action is worth; of what is masked out, as good as nothing."""
        return self.nets["actor"](seen).masked_fill(masks == 0, -1e9)

    def play(self) -> Steps:
        """So many steps of all copies."""
        torch, batch, settings = self.torch, self.batch, self.settings
        arrays, rows = batch.arrays, []
        with torch.no_grad():
            for _ in range(settings.length):
                seen, masks = self.scaled(self.obs.float()), self.masks.clone()
                live = torch.from_numpy(arrays.live.copy())
                masks[~live] = 1  # nobody is there: any action will do
                chance = torch.distributions.Categorical(logits=self.logits(seen, masks))
                actions, values = chance.sample(), self.nets["critic"](seen).squeeze(-1)
                likely = chance.log_prob(actions)
                _, _, terminated, truncated = batch.step(actions.numpy())
                paid = torch.from_numpy(arrays.terms).float() @ self.weights + self._beyond(
                    truncated
                )
                goes_on = live & ~torch.from_numpy(terminated | truncated)
                rows.append((seen, masks, live, actions, likely, values, paid, goes_on))
            after = self.nets["critic"](self.scaled(self.obs.float())).squeeze(-1)
        columns = [torch.stack(column) for column in zip(*rows, strict=True)]
        self.note(torch.from_numpy(arrays.obs[arrays.live]).float())
        return Steps(*columns, after)

    def _beyond(self, truncated: Array) -> Any:
        """What those who were cut off would have had, discounted, [copy, robot]; 0 of others."""
        beyond, arrays = self.torch.zeros(truncated.shape), self.batch.arrays
        cut = truncated & arrays.ended[:, None]
        if cut.any():
            last = self.scaled(self.torch.from_numpy(arrays.final[cut]).float())
            values = self.nets["critic"](last).squeeze(-1)
            beyond[self.torch.from_numpy(cut)] = self.settings.discount * values
        return beyond

    def advantages(self, steps: Steps) -> Any:
        """How much better each step was than expected, [step, copy, robot]."""
        settings, torch = self.settings, self.torch
        found, ahead, after = torch.zeros_like(steps.values), torch.zeros(()), steps.after
        for t in range(settings.length - 1, -1, -1):
            goes_on = steps.goes_on[t].float()
            error = steps.rewards[t] + settings.discount * goes_on * after - steps.values[t]
            ahead = error + settings.discount * settings.trace * goes_on * ahead
            found[t], after = ahead, steps.values[t]
        return found

    def learn(self, steps: Steps, optimizer: Any) -> None:
        """A few passes over the steps at whose beginning a robot was there."""
        torch, settings, live = self.torch, self.settings, steps.live
        better = self.advantages(steps)[live]
        returns, likely = better + steps.values[live], steps.likely[live]
        seen, masks, actions = steps.seen[live], steps.masks[live], steps.actions[live]
        better = (better - better.mean()) / (better.std() + 1e-8)
        for _ in range(settings.epochs):
            for rows in torch.randperm(len(seen)).split(settings.minibatch):
                chance = torch.distributions.Categorical(
                    logits=self.logits(seen[rows], masks[rows])
                )
                ratio = (chance.log_prob(actions[rows]) - likely[rows]).exp()
                held = ratio.clamp(1 - settings.clip, 1 + settings.clip)
                gain = torch.minimum(ratio * better[rows], held * better[rows]).mean()
                miss = (self.nets["critic"](seen[rows]).squeeze(-1) - returns[rows]).square().mean()
                loss = 0.5 * miss - gain - settings.entropy * chance.entropy().mean()
                optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(self.nets.parameters(), 0.5)
                optimizer.step()

    def run(self) -> Iterator[int]:
        """Learns until enough steps are played; yields how many were, after each update."""
        settings = self.settings
        optimizer = self.torch.optim.Adam(self.nets.parameters(), lr=settings.rate, eps=1e-5)
        self.note(self.torch.from_numpy(self.batch.arrays.obs[self.batch.arrays.live]).float())
        while self.played < settings.steps:
            for group in optimizer.param_groups:
                group["lr"] = settings.rate * (1 - self.played / settings.steps)
            steps = self.play()
            self.learn(steps, optimizer)
            self.played += int(steps.live.sum())
            yield self.played

    def act(self, seen: Array, masks: Array, live: Array) -> Array:
        """Actions drawn for all places, as `Robots` draws them."""
        torch = self.torch
        with torch.no_grad():
            flags = torch.from_numpy(np.where(live[..., None], masks, 1))
            logits = self.logits(self.scaled(torch.from_numpy(seen).float()), flags)
            return np.asarray(torch.distributions.Categorical(logits=logits).sample())

    def save(self, path: Path) -> None:
        """Writes what `Robots` reads."""
        weights = {name: value.numpy() for name, value in self.nets.state_dict().items()}
        actor = {name: value for name, value in weights.items() if name.startswith("actor")}
        scale = {"mean": self.mean.numpy(), "deviation": self.deviation().numpy()}
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **actor, **scale)


# What it comes to.


def played(batch: Batch, act: Callable[[Array, Array, Array], Array]) -> dict[str, Array]:
    """The first episode of each copy: whether it was solved, deliveries, return per robot."""
    episodes, kernel = batch.num_envs, batch.kernel
    batch.reset()
    a, over = batch.arrays, np.zeros(episodes, bool)
    found = {"solved": np.zeros(episodes), "delivered": np.zeros(episodes)}
    found["return"] = np.zeros(episodes)
    delivery = list(kernel.terms).index("delivery") if "delivery" in kernel.terms else 0
    while not over.all():
        batch.step(act(a.obs, a.masks, a.live))
        found["delivered"] += np.where(over, 0.0, a.terms[..., delivery].max(1))
        found["return"] += np.where(over, 0.0, a.rewards.sum(1) / len(kernel.agents))
        found["solved"] += ~over & a.ended & a.terminated.any(1)
        over |= a.ended
    return found


def legal(seed: int) -> Callable[[Array, Array, Array], Array]:
    """Draws any action that isn't masked out."""
    rng = np.random.default_rng(seed)

    def act(seen: Array, masks: Array, live: Array) -> Array:
        flags = np.where(live[..., None], masks, 1)
        return np.argmax(rng.random(flags.shape) * flags, axis=-1)

    return act


def interval(values: Array) -> list[float]:
    """Mean, and the ends of its 95 % interval by bootstrap."""
    rng = np.random.default_rng(0)
    means = rng.choice(values, (2_000, len(values))).mean(1)
    return [round(float(x), 3) for x in (values.mean(), *np.percentile(means, [2.5, 97.5]))]


def main() -> None:
    """Learns with each seed; prints progress and results as JSON lines."""
    parser, usual = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]), Settings()
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--steps", type=float, default=usual.steps)
    parser.add_argument("--env", default=usual.env)
    parser.add_argument("--kwargs", type=json.loads, default=SMALL, help="of env, as JSON")
    parser.add_argument("--episodes", type=int, default=500, help="that are played to judge")
    parser.add_argument("--out", type=Path, default=Path("runs/ppo"))
    options = parser.parse_args()
    settings = Settings(env=options.env, env_kwargs=options.kwargs, steps=int(options.steps))
    kernel = gk.make(settings.env, **settings.env_kwargs).kernel
    lines = [{"settings": asdict(settings)}]
    not_exercised = Batch(
        kernel, options.episodes, seed=1_000_000
    )  # episodes that nobody learnt from
    lines.append(_line("random", played(not_exercised, legal(0))))
    for seed in options.seeds:
        learner, few = Learner(kernel, settings, seed), Batch(kernel, 64, seed=seed + 1)
        begun, busy = time.perf_counter(), time.process_time()
        for update, steps in enumerate(learner.run()):
            if update % 20 == 0:
                spent = {"steps": steps, "wall_s": round(time.perf_counter() - begun)}
                line = _line("learning", played(few, learner.act))
                print(json.dumps({"seed": seed, **spent, **line}), flush=True)
        spent = {
            "steps": steps,
            "wall_s": round(time.perf_counter() - begun),
            "cpu_s": round(time.process_time() - busy),
        }
        learner.save(options.out / f"seed_{seed}.npz")
        lines.append({"seed": seed, **spent, **_line("learnt", played(not_exercised, learner.act))})
        print(json.dumps(lines[-1]), flush=True)
    text = "\n".join(json.dumps(line) for line in lines)
    (options.out / "results.jsonl").write_text(text + "\n", encoding="utf-8")


def _line(policy: str, found: Mapping[str, Array]) -> dict[str, Any]:
    return {"policy": policy, **{name: interval(values) for name, values in found.items()}}


if __name__ == "__main__":
    main()
