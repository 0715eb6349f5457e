"""One network learns connect four by playing itself: PPO over a batch of compiled games, one file.

Needs torch (`pip install 'gamekeeper[fast]' torch`):

    python examples/selfplay_connect_four.py --seed 0

What it shows of an environment in which agents take turns:
    - `Slots` has a place for each player of each game. In every step one of the two acts, the other
      waits; `acting` says who, `masks` what it may do, and what is masked out has probability 0.
    - A player's decisions are its own: what follows a move is what the player sees when it is its
      turn again, and what it is paid meanwhile belongs to that move. Who loses is paid -1 while the
      other moves; `decided` gives it to the move that allowed it. Moves whose sequel isn't known
      yet, because the game goes on beyond the last step, are left out.
    - One network plays both sides, and sees the board from the side that it plays. So that games
      differ, their first tokens fall anywhere, and in a part of them one side is weak: its tokens
      fall anywhere with a chance that is drawn for the game. None of this is learnt from.
    - What was learnt is a policy like any other. It is judged in recorded games, as either player,
      against scripts that it never met; there too the first four tokens fall anywhere.

Source: Schulman et al. 2017, "Proximal Policy Optimization Algorithms"; Huang et al. 2022,
"CleanRL" (the manner).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow.compute as pc
import torch
from torch import nn
from torch.distributions import Categorical

import gamekeeper as gk
from gamekeeper.adapters.decisions import decided
from gamekeeper.adapters.slots import Slots
from gamekeeper.statistics.significance import wilson
from gamekeeper.tasks.connect_four import greedy, reference

PLAYERS: Final = ("player_0", "player_1")
WANTED: Final = {"random": 0.88, "greedy": 0.75, "reference": 0.18}
"""Least lower ends of the intervals of games won, both colours together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Args:
    """What a run depends on, beside its seed.

    Attributes:
        games, length: played at once, and so many moves in each between two updates.
        moves: of all games together.
        opening: at most so many first tokens fall anywhere; as many as are drawn for a game.
        weak: part of the games that have a weak side.
        epochs, minibatch: how often an update sees each move, and how many at once.
        rate: of learning; it falls to zero. discount, trace: gamma and lambda.
        clip, entropy: how far chances may move, and what staying undecided is worth.
    """

    engine: str = "kernel"
    games: int = 64
    length: int = 64
    moves: int = 800_000
    opening: int = 4
    weak: float = 0.25
    epochs: int = 3
    minibatch: int = 512
    rate: float = 2e-3
    discount: float = 0.99
    trace: float = 0.9
    clip: float = 0.2
    entropy: float = 0.02


def rows_of_four() -> torch.Tensor:
    """The 69 rows of four cells of the board, [42, 69]: 1 where a cell is in a row."""
    found = []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for y, x in np.ndindex(6, 7):
            row = [(y + k * down, x + k * right) for k in range(4)]
            if row[3][0] < 6 and 0 <= row[3][1] < 7:
                found.append([cell in row for cell in np.ndindex(6, 7)])
    return torch.tensor(found).T.float()


class Network(nn.Module):
    """From boards [games, 6, 7, 2] to chances of columns [games, 7] and values [games].

    Beside the cells it is shown in which rows of four one side has two or three tokens alone.
    """

    def __init__(self) -> None:
        super().__init__()
        self.rows = rows_of_four()
        self.body = nn.Sequential(nn.Linear(84 + 4 * 69, 192), nn.ReLU(), nn.Linear(192, 128))
        self.column, self.value = nn.Linear(128, 7), nn.Linear(128, 1)
        nn.init.normal_(self.column.weight, std=0.01)

    def forward(self, boards: torch.Tensor, masks: torch.Tensor) -> tuple[Categorical, Any]:
        """How likely each open column is, and what is expected."""
        cells = boards.reshape(-1, 42, 2).float()
        own, other = cells[..., 0] @ self.rows, cells[..., 1] @ self.rows
        sides = ((own, other), (other, own))
        shown = [((one == n) & (two == 0)).float() for one, two in sides for n in (2, 3)]
        seen = self.body(torch.cat([cells.flatten(1), *shown], -1)).relu()
        logits = self.column(seen).masked_fill(masks == 0, -1e9)
        return Categorical(logits=logits, validate_args=False), self.value(seen).squeeze(-1)


class Learnt:
    """A policy, for `gk.rollout` and whoever plays: the likeliest column of a network."""

    def __init__(self, network: Network) -> None:
        self.network = network
        weights = b"".join(bytes(weight.numpy()) for weight in network.state_dict().values())
        self.version = hashlib.blake2b(weights, digest_size=8).hexdigest()

    def __call__(self, observation: Any, agent: str, info: Any, rng: np.random.Generator) -> int:
        """An open column."""
        shown = (torch.from_numpy(observation[key])[None] for key in ("observation", "action_mask"))
        with torch.no_grad():
            return int(self.network(*shown)[0].probs.argmax())


class AnyOpening:
    """A policy that drops the first tokens of a game anywhere, and then plays as another does."""

    def __init__(self, policy: Callable[..., int], tokens: int = 4) -> None:
        self.policy, self.tokens = policy, tokens
        self.version = f"{tokens} anywhere, {getattr(policy, 'version', '') or policy.__name__}"

    def __call__(self, observation: Any, agent: str, info: Any, rng: np.random.Generator) -> int:
        """An open column."""
        opens = observation["observation"].sum() < self.tokens
        return (anywhere if opens else self.policy)(observation, agent, info, rng)


def anywhere(observation: Any, agent: str, info: Any, rng: np.random.Generator) -> int:
    """Any open column."""
    return int(rng.choice(np.flatnonzero(observation["action_mask"])))


Moves = namedtuple("Moves", "boards masks columns likely learnt advantages returns")
"""What was played between two updates: a move of each game in each step, [step, game, ...]."""


class SelfPlay:
    """Plays games against itself, and learns from them."""

    def __init__(self, args: Args, seed: int) -> None:
        torch.manual_seed(seed)
        self.args, self.rng, self.network = args, np.random.default_rng(seed), Network()
        self.slots = Slots("connect_four", args.games, seed=seed, engine=args.engine)
        self.seen = self.slots.reset()
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=args.rate, eps=1e-5)
        self.opening, self.slips = np.zeros(args.games, np.int64), np.zeros(self.slots.count)
        self.begin(np.arange(args.games))
        self.played = 0

    def begin(self, games: Any) -> None:
        """Draws how the next of these games is spoilt, so that no two are alike."""
        args, rng = self.args, self.rng
        self.opening[games] = rng.integers(0, args.opening + 1, len(games))
        self.slips[2 * games] = self.slips[2 * games + 1] = 0.0
        weak = games[rng.random(len(games)) < args.weak]
        self.slips[2 * weak + rng.integers(0, 2, len(weak))] = rng.random(len(weak))

    def choose(self, rows: Any) -> tuple[Any, ...]:
        """For slots that act: boards, masks, columns, how likely these were, whose are learnt."""
        boards, masks = torch.from_numpy(self.seen[rows]), torch.from_numpy(self.slots.masks[rows])
        chance, values = self.network(boards, masks)
        tokens, slips = boards.sum((1, 2, 3)).numpy(), self.slips[rows]
        is_own = torch.from_numpy((tokens >= self.opening) & (slips == 0.0))
        slips = torch.from_numpy((tokens < self.opening) | (self.rng.random(len(rows)) < slips))
        anywhere = (torch.rand(masks.shape) * masks).argmax(-1)
        columns = torch.where(slips, anywhere, chance.sample())
        return boards, masks, columns, chance.log_prob(columns), is_own, values

    @torch.no_grad()
    def play(self) -> Moves:
        """So many steps of all games."""
        slots, args = self.slots, self.args
        shape = (args.length, slots.count)
        rewards, values, after = np.zeros(shape), np.zeros(shape), np.zeros(slots.count)
        acted, ends = np.zeros(shape, bool), np.zeros(shape, bool)
        kept, places = [], []
        for t in range(args.length):
            rows = np.flatnonzero(slots.acting)  # one in each game
            *move, worth = self.choose(rows)
            kept.append(move)
            places.append(rows)
            values[t, rows], acted[t, rows] = worth, True
            actions = np.zeros(slots.count, np.int64)
            actions[rows] = move[2]
            step = slots.step(actions)
            self.seen, rewards[t], ends[t] = step.obs, step.rewards, step.terminated
            self.begin(np.flatnonzero(ends[t][::2]))  # both players end together
        rows = np.flatnonzero(slots.acting)
        after[rows] = self.choose(rows)[-1]
        found = (rewards, values, acted, ends, after, slots.acting)
        better, known = decided(*found, gamma=args.discount, gae_lambda=args.trace)
        arrays = (np.take_along_axis(one, np.array(places), 1) for one in (better, values, known))
        better, values, known = map(torch.from_numpy, arrays)
        *columns, is_own = (torch.stack(column) for column in zip(*kept, strict=True))
        return Moves(*columns, is_own & known, better.float(), (better + values).float())

    def learn(self, moves: Moves) -> dict[str, float]:
        """A few passes over the own moves whose sequel is known; what they showed."""
        args, own = self.args, moves.learnt
        boards, masks, columns, likely, _, better, returns = (part[own] for part in moves)
        explained = 1 - (better.var() / returns.var()).item()
        better = (better - better.mean()) / (better.std() + 1e-8)
        for _ in range(args.epochs):
            for rows in torch.randperm(len(boards)).split(args.minibatch):
                chance, values = self.network(boards[rows], masks[rows])
                ratio = (chance.log_prob(columns[rows]) - likely[rows]).exp()
                held = ratio.clamp(1 - args.clip, 1 + args.clip)
                gain = torch.minimum(ratio * better[rows], held * better[rows]).mean()
                miss = (values - returns[rows]).square().mean()
                undecided = chance.entropy().mean()
                self.optimizer.zero_grad()
                (0.5 * miss - gain - args.entropy * undecided).backward()
                nn.utils.clip_grad_norm_(self.network.parameters(), 0.5)
                self.optimizer.step()
        return {"entropy": undecided.item(), "explained_variance": explained}

    def update(self) -> dict[str, float]:
        """Plays and learns once; what it showed."""
        for group in self.optimizer.param_groups:
            group["lr"] = self.args.rate * max(1 - self.played / self.args.moves, 0.0)
        told = self.learn(self.play())
        self.played += self.args.games * self.args.length
        return told


def judged(policy: Any, opponent: Any, games: int, out: Path | None = None) -> list[dict[str, Any]]:
    """Recorded games as either player: how many were won and drawn, and their fingerprint."""
    found = []
    for player, other in (PLAYERS, PLAYERS[::-1]):
        evidence = gk.rollout(
            "connect_four",
            policies={player: AnyOpening(policy), other: AnyOpening(opponent)},
            episodes=games,
            seed=1_000_000,
            out=out / player if out else None,
        )
        steps = evidence.agent_steps.filter(pc.field("agent") == player)
        paid = steps.group_by("episode").aggregate([("reward", "sum")])["reward_sum"].to_numpy()
        told = {"as": player, "won": int((paid > 0).sum()), "drawn": int((paid == 0).sum())}
        found.append({**told, "fingerprint": evidence.fingerprint})
    return found


def main(arguments: list[str] | None = None) -> int:
    """Learns with one seed, judges, and prints one line of JSON; 1 where too little was learnt."""
    usual, parser = Args(), argparse.ArgumentParser()
    option = parser.add_argument
    option("--seed", type=int, default=0)
    option("--engine", default=usual.engine, help="kernel, or serial without Numba")
    option("--moves", type=int, default=usual.moves)
    option("--out", type=Path, help="a folder for the evidence")
    option("--quick", action="store_true", help="a few moves, whatever comes of them")
    given = parser.parse_args(arguments)
    args, games = Args(engine=given.engine, moves=given.moves), 500
    if given.quick:
        args, games = replace(args, games=8, length=32, moves=1_000), 4
    torch.set_num_threads(1)
    begun, busy = time.perf_counter(), time.process_time()
    selves = SelfPlay(args, given.seed)
    while selves.played < args.moves:
        told = selves.update()
        print(selves.played, *(f"{k} {value:.3f}" for k, value in told.items()), file=sys.stderr)
    seconds, cpu_s = time.perf_counter() - begun, time.process_time() - busy
    learnt, found = Learnt(selves.network), {}
    for name, opponent in (("random", anywhere), ("greedy", greedy), ("reference", reference)):
        sides = judged(learnt, opponent, games, given.out / name if given.out else None)
        share = wilson(sum(side["won"] for side in sides), 2 * games)
        found[name] = {"won": [share.p, share.low, share.high], "of": share.n, "sides": sides}
    result = {name: round(told["won"][1], 3) for name, told in found.items()}
    reached = all(result[name] >= wanted for name, wanted in WANTED.items())
    line = {
        "example": "selfplay_connect_four",
        "trainer": f"torch {torch.__version__}",
        "task": "connect_four",
        "seed": given.seed,
        "steps": args.moves,
        "seconds": round(seconds, 1),
        "cpu_s": round(cpu_s, 1),
        "measure": "part of games won as either player, lower end of Wilson's 95 % interval",
        "result": result,
        "wanted": WANTED,
        "reached": reached,
        "games": found,
        "engine": args.engine,
        "version": learnt.version,
    }
    print(json.dumps(line))
    return 0 if reached or given.quick else 1


if __name__ == "__main__":
    sys.exit(main())
