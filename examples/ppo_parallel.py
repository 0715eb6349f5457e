"""PPO with shared parameters on any Parallel environment, in one file that is read top to bottom.

Needs torch (`pip install 'gamekeeper[fast]' torch mpe2`):

    python examples/ppo_parallel.py                                  # mpe2's simple_spread
    python examples/ppo_parallel.py --env spread --engine kernel     # ours, with compiled rules

What it shows of many copies, whose arrays are [copy, agent, ...]:
    - Agents that share their spaces share a network; where spaces differ, arrays come by role, and
      each has its own. Agents end alone, or join late: only steps at whose beginning
      `infos["live"]` says that somebody was there are learnt from.
    - After a termination nothing follows; after a truncation the critic says what would have, from
      an agent's last observation: in `obs`, or in `infos["final_obs"]` where a copy began anew.
    - What is masked out has probability 0. Returns are of whole episodes, by agent and by role.
    - With `--checkpoint` networks, optimizers and torch's draws are saved after every part of the
      steps, and read if the file is there: a run that was stopped goes on, and ends with the
      weights that it would have had, because all copies begin anew with each part.
    - What was learnt is judged in fresh episodes, with an interval; they are recorded, and replayed
      (`--out` keeps them). `--evaluate` judges a checkpoint without learning.

Source: Schulman et al. 2017 (PPO); Pardo et al. 2018 (time limits); Huang et al. 2022 (CleanRL).
"""

from __future__ import annotations

import argparse
import atexit
import hashlib
import json
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from gymnasium.spaces import Discrete
from torch import nn
from torch.distributions import Categorical

import gamekeeper as gk
from gamekeeper.episodes.layout import role
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.statistics.one_sample import one_sample

MASK: Final = "action_mask"
SPREAD: Final = "mpe2.simple_spread_v3:parallel_env"
WANTED: Final = {SPREAD: -21.0, "spread": -21.0}
"""Return of an agent that the lower end of the 95 % interval of the mean of episodes is to beat;
elsewhere the mean is to beat random's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Args:
    """What a run depends on, beside its seed.

    Attributes:
        steps: of all agents together. hidden: units in each of the two layers.
        part: steps after which all copies begin anew, and a checkpoint is written.
        copies, length: played at once, and so many steps between two updates.
        epochs, minibatch: how often an update sees each step, and how many at once.
        rate: of learning; it falls to zero. discount, trace: gamma and lambda.
        clip, entropy: how far chances may move, and what staying undecided is worth.
    """

    env: str = SPREAD
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    engine: str = "serial"
    steps: int = 300_000
    part: int = 100_000
    copies: int = 32
    length: int = 25
    epochs: int = 4
    minibatch: int = 600
    rate: float = 1e-3
    discount: float = 0.95
    trace: float = 0.95
    clip: float = 0.2
    entropy: float = 0.01
    hidden: int = 64


def flat(seen: Any, lead: int) -> torch.Tensor:
    """Numbers of an observation but its mask, [*lead, numbers]; float32 ones aren't copied."""
    if isinstance(seen, Mapping):
        seen = tuple(part for key, part in seen.items() if key != MASK)
    if isinstance(seen, tuple):
        return torch.cat([flat(part, lead) for part in seen], -1)
    array = torch.as_tensor(np.asarray(seen))
    return array.reshape(*array.shape[:lead], -1).float()


def layers(numbers: int, hidden: int, outputs: int, *, gain: float) -> nn.Sequential:
    """Two layers of hidden units, and what comes out of them."""
    one, two, last = (nn.Linear(*pair) for pair in pairwise((numbers, hidden, hidden, outputs)))
    for layer, scale in ((one, 2**0.5), (two, 2**0.5), (last, gain)):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(one, nn.Tanh(), two, nn.Tanh(), last)


class Learner:
    """A group of agents with their network, in all copies; arrays are [step, copy, agent, ...]."""

    def __init__(self, group: Any, args: Args, obs: Any) -> None:
        if not isinstance(group.action_space, Discrete):
            raise ValueError(f"{group.agents[0]} acts in {group.action_space}, not in a Discrete")
        self.group, self.args, self.actions = group, args, int(group.action_space.n)
        self.first, numbers = int(group.action_space.start), flat(self.of(obs), 2).shape[-1]
        self.actor = layers(numbers, args.hidden, self.actions, gain=0.01)
        self.critic = layers(numbers, args.hidden, 1, gain=1.0)
        self.network = nn.ModuleList([self.actor, self.critic])
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=args.rate, eps=1e-5)
        shape = (args.length, args.copies, len(group.agents))
        self.seen, self.masks = torch.zeros(*shape, numbers), torch.ones(*shape, self.actions)
        self.live, self.goes_on = torch.zeros(shape).bool(), torch.zeros(shape).bool()
        self.did, self.likely = torch.zeros(shape).long(), torch.zeros(shape)
        self.values, self.rewards = torch.zeros(shape), torch.zeros(shape)

    def kept(self) -> dict[str, Any]:
        """Weights, and what the optimizer remembers."""
        return {"network": self.network.state_dict(), "optimizer": self.optimizer.state_dict()}

    def go_on(self, kept: Mapping[str, Any]) -> None:
        """Takes over what `kept` gave."""
        self.network.load_state_dict(kept["network"])
        self.optimizer.load_state_dict(kept["optimizer"])

    def of(self, tree: Any) -> Any:
        """Its part of what the vector environment gives; all of it where there is one group."""
        return tree[self.group.name] if self.group.name else tree

    def chance(self, seen: torch.Tensor, masks: torch.Tensor) -> Categorical:
        """What to draw an action from."""
        logits = self.actor(seen).masked_fill(masks == 0, -1e9)
        return Categorical(logits=logits, validate_args=False)

    def value(self, seen: torch.Tensor) -> torch.Tensor:
        """What is expected from here on, discounted."""
        return self.critic(seen).squeeze(-1)

    @torch.no_grad()
    def act(self, t: int, obs: Any, infos: Mapping[str, Any]) -> Any:
        """Actions [copy, agent] of step t; notes what they rest on."""
        self.seen[t] = flat(self.of(obs), 2)
        self.live[t] = torch.from_numpy(self.of(infos["live"]))
        if self.group.flags:
            masks = torch.from_numpy(self.of(infos[MASK]))
            self.masks[t] = torch.where(self.live[t][..., None], masks, 1)  # nobody there: any
        chance = self.chance(self.seen[t], self.masks[t])
        self.did[t] = chance.sample()
        self.likely[t] = chance.log_prob(self.did[t])
        self.values[t] = self.value(self.seen[t])
        return self.did[t].numpy() + self.first

    @torch.no_grad()
    def note(self, t: int, obs: Any, paid: list[Any], infos: Mapping[str, Any]) -> None:
        """Keeps what step t paid, and adds what those who were cut off would have had."""
        rewards, terminated, truncated = map(self.of, paid)
        self.goes_on[t] = self.live[t] & ~torch.from_numpy(terminated | truncated)
        self.rewards[t] = torch.from_numpy(rewards)
        cut = torch.from_numpy(truncated & ~terminated)
        if cut.any():
            last = flat(self.of(obs), 2).clone()
            for copy in np.flatnonzero(infos.get("_final_obs", ())):
                last[copy] = flat(self.of(infos["final_obs"][copy]), 1)
            self.rewards[t][cut] += self.args.discount * self.value(last[cut])

    @torch.no_grad()
    def advantages(self, obs: Any) -> torch.Tensor:
        """How much better each step was than expected; `obs` is what follows the last one."""
        args, found = self.args, torch.zeros_like(self.values)
        after, ahead = self.value(flat(self.of(obs), 2)), torch.zeros(())
        for t in reversed(range(args.length)):
            goes_on = self.goes_on[t].float()
            error = self.rewards[t] + args.discount * goes_on * after - self.values[t]
            found[t] = ahead = error + args.discount * args.trace * goes_on * ahead
            after = self.values[t]
        return found

    def learn(self, obs: Any, rate: float) -> dict[str, float]:
        """A few passes over the steps at whose beginning somebody was there; what they showed."""
        args, live = self.args, self.live
        if live.sum() < 2:  # none of them was there
            return {}
        better = self.advantages(obs)[live]
        returns, likely, did = better + self.values[live], self.likely[live], self.did[live]
        seen, masks = self.seen[live], self.masks[live]
        explained = 1 - (better.var() / returns.var()).item()
        better = (better - better.mean()) / (better.std() + 1e-8)
        self.optimizer.param_groups[0]["lr"] = rate
        for _ in range(args.epochs):
            for rows in torch.randperm(len(seen)).split(args.minibatch):
                chance = self.chance(seen[rows], masks[rows])
                ratio = (chance.log_prob(did[rows]) - likely[rows]).exp()
                held = ratio.clamp(1 - args.clip, 1 + args.clip)
                gain = torch.minimum(ratio * better[rows], held * better[rows]).mean()
                miss = (self.value(seen[rows]) - returns[rows]).square().mean()
                undecided = chance.entropy().mean()
                self.optimizer.zero_grad()
                (0.5 * miss - gain - args.entropy * undecided).backward()
                nn.utils.clip_grad_norm_(self.network.parameters(), 0.5)
                self.optimizer.step()
        return {"entropy": undecided.item(), "explained_variance": explained}


class Learnt:
    """What was learnt, as a policy for `gk.rollout` and whoever plays: draws as it learnt to."""

    def __init__(self, learners: list[Learner]) -> None:
        self.of = {agent: learner for learner in learners for agent in learner.group.agents}
        weights = [w.numpy() for one in learners for w in one.network.state_dict().values()]
        self.version = hashlib.blake2b(b"".join(map(bytes, weights)), digest_size=8).hexdigest()

    @torch.no_grad()
    def __call__(self, observation: Any, agent: str, info: Any, rng: np.random.Generator) -> int:
        """An action that isn't masked out."""
        learner = self.of[agent]
        told = observation if isinstance(observation, Mapping) and MASK in observation else info
        masks = torch.as_tensor(np.asarray(told.get(MASK, np.ones(learner.actions, np.int8))))
        chance = learner.chance(flat(observation, 0), masks).probs.double().numpy()
        return learner.first + int(rng.choice(learner.actions, p=chance / chance.sum()))


def save(file: Path, learners: list[Learner], played: int) -> None:
    """Writes a checkpoint; a file that is there is replaced once the new one is whole."""
    parts = {learner.group.name: learner.kept() for learner in learners}
    whole = {"played": played, "draws": torch.get_rng_state(), "learners": parts}
    torch.save(whole, file.with_suffix(".new"))
    file.with_suffix(".new").replace(file)


def load(file: Path, learners: list[Learner]) -> int:
    """Reads a checkpoint into learners and torch's draws; returns the steps played so far."""
    whole = torch.load(file, weights_only=True)
    for learner in learners:
        learner.go_on(whole["learners"][learner.group.name])
    torch.set_rng_state(whole["draws"])
    return int(whole["played"])


def opened(args: Args, seed: int) -> Any:
    """Copies of the environment, whose arrays are the engine's own: the next step overwrites."""
    options = {"engine": args.engine, "env_kwargs": args.env_kwargs, "copy": False}
    venv = gk.vector.make(args.env, args.copies, seed=seed, **options)
    if venv.api != "parallel":
        raise ValueError(f"{args.env}: agents take turns; see selfplay_connect_four.py")
    return venv


def loaded(args: Args, file: Path) -> list[Learner]:
    """Learners as they stood in a checkpoint."""
    with opened(replace(args, copies=1), 0) as venv:
        obs, _ = venv.reset()
        learners = [Learner(group, args, obs) for group in venv.groups]
    load(file, learners)
    return learners


Log = Callable[[str, float, int], object]


def train(args: Args, seed: int, log: Log, file: Path | None = None) -> list[Learner]:
    """Learns, or goes on from the file; logs what updates show, and returns of whole episodes."""
    torch.manual_seed(seed)
    with opened(args, seed) as venv:
        obs, _ = venv.reset()
        learners, played = [Learner(group, args, obs) for group in venv.groups], 0
        if file is not None and file.exists():
            played = load(file, learners)
        while played < args.steps:
            until = min(args.steps, (played // args.part + 1) * args.part)
            obs, infos = venv.reset(seed=episode_seed(seed, played))
            played = learn_part(args, venv, learners, (obs, infos), (played, until), log)
            if file is not None:
                save(file, learners, played)
    return learners


def learn_part(
    args: Args, venv: Any, learners: list[Learner], given: Any, span: tuple[int, int], log: Log
) -> int:
    """Plays and learns from the first number of steps to the second; returns those played."""
    (obs, infos), (played, until) = given, span
    agents = [agent for group in venv.groups for agent in group.agents]
    sums, returns = np.zeros((args.copies, len(agents))), defaultdict(list)
    while played < until:
        for t in range(args.length):
            actions = {learner.group.name: learner.act(t, obs, infos) for learner in learners}
            obs, *paid, infos = venv.step(actions.get("", actions))
            for learner in learners:
                learner.note(t, obs, paid, infos)
                sums[:, learner.group.columns] += learner.of(paid[0])
            over = np.flatnonzero(infos["over"])
            for agent, totals in zip(agents, sums[over].T, strict=True):
                returns[f"agent/{agent}"].extend(totals)
                returns[f"role/{role(agent)}"].extend(totals)
            sums[over] = 0.0
        for learner in learners:
            for name, value in learner.learn(obs, args.rate * (1 - played / args.steps)).items():
                log(f"{name}/{learner.group.name or 'all'}", value, played)
            played += int(learner.live.sum())
        for name in [name for name in returns if returns[name]]:
            log(f"return/{name}", float(np.mean(returns.pop(name))), played)
    return played


def logger(folder: Path | None) -> Log:
    """Shows everything on stderr; with a folder, in TensorBoard."""
    if folder is not None:
        from torch.utils.tensorboard import SummaryWriter

        board = SummaryWriter(folder)
        atexit.register(board.close)  # which writes what isn't on disk yet
        return board.add_scalar
    return lambda name, value, played: print(played, name, round(value, 3), file=sys.stderr)


def judged(args: Args, policy: Any, episodes: int, out: Path | None = None) -> tuple[Any, Any]:
    """Evidence of episodes that nobody learnt from, and in each the mean return of an agent."""
    evidence = gk.rollout(
        args.env,
        policies=policy,
        episodes=episodes,
        seed=1_000_000,
        out=out,
        env_kwargs=args.env_kwargs,
    )
    returns = evidence.agent_steps.group_by(["episode", "agent"]).aggregate([("reward", "sum")])
    means = returns.group_by("episode").aggregate([("reward_sum", "mean")])
    return evidence, means["reward_sum_mean"].to_numpy()


def options() -> argparse.ArgumentParser:
    """What the command line takes."""
    usual, parser = Args(), argparse.ArgumentParser()
    option = parser.add_argument
    option("--seed", type=int, default=0)
    option("--env", default=usual.env)
    option("--kwargs", type=json.loads, default={}, help="of env, as JSON")
    option("--engine", default=usual.engine, help="serial, process or kernel")
    option("--steps", type=int, default=usual.steps)
    option("--checkpoint", type=Path, help="a file that is gone on from, and written")
    option("--evaluate", action="store_true", help="the checkpoint, without learning")
    option("--tensorboard", type=Path, help="a folder; needs tensorboard")
    option("--out", type=Path, help="a folder for the evidence")
    option("--quick", action="store_true", help="a few steps, whatever comes of them")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Learns with one seed, judges, and prints one line of JSON; 1 where too little was learnt."""
    given = options().parse_args(arguments)
    args = Args(env=given.env, env_kwargs=given.kwargs, engine=given.engine, steps=given.steps)
    args = replace(args, steps=1_000, part=500, copies=4) if given.quick else args
    torch.set_num_threads(1)
    begun, busy = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        file = given.checkpoint or Path(scratch) / "checkpoint.pt"
        if not given.evaluate:
            train(args, given.seed, logger(given.tensorboard), file)
        line = {
            "example": "ppo_parallel",
            "trainer": f"torch {torch.__version__}",
            "task": args.env,
            "engine": args.engine,
            "seed": given.seed,
            "steps": 0 if given.evaluate else args.steps,
            "seconds": round(time.perf_counter() - begun, 1),
            "cpu_s": round(time.process_time() - busy, 1),
        }
        learnt, out = Learnt(loaded(args, file)), given.out or Path(scratch) / "run"
        line |= verdict(args, learnt, 2 if given.quick else 200, out)
    print(json.dumps(line))
    return 0 if line["replayed"] and (line["reached"] or given.quick) else 1


def verdict(args: Args, policy: Any, episodes: int, out: Path) -> dict[str, Any]:
    """Judges a policy in recorded episodes, beside random play, and replays them."""
    _, by_chance = judged(args, "random", episodes)
    evidence, found = judged(args, policy, episodes, out)
    shown = one_sample(found, rng=np.random.default_rng(0)) if episodes > 2 else None
    wanted = WANTED.get(args.env, float(np.mean(by_chance)))
    beats = shown.low if shown and args.env in WANTED else float(np.mean(found))
    return {
        "measure": f"return of an agent, mean of {episodes} episodes",
        "result": round(float(np.mean(found)), 2),
        "interval": shown and [round(shown.low, 2), round(shown.high, 2)],
        "wanted": round(wanted, 2),
        "reached": beats > wanted,
        "random": round(float(np.mean(by_chance)), 2),
        "fingerprint": evidence.fingerprint,
        "replayed": gk.replay(out).verified,
    }


if __name__ == "__main__":
    sys.exit(main())
