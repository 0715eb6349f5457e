"""An environment of one's own, two roles with different actions, learnt with RLlib's PPO.

Needs `pip install 'gamekeeper[rllib]'`. A walker and a runner stand in one corridor of nine places,
no two in the same; each is paid 1 for reaching its own lamp, less 0.05 a tick, and has ended then.
After 15 ticks who is left is cut off. The walker takes one place a tick; the runner up to two, and
so leaps over the walker. A mask forbids what leads out of the corridor or onto the other.

    python examples/rllib_own.py --seed 0

A module for each role learns half of the steps; the algorithm is saved, and another one goes on
from the checkpoint, learns the rest and is saved again. Out of that checkpoint 200 games are played
that weren't learnt from, recorded and replayed. One JSON line; exit status 1 if the wanted result
isn't reached.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small networks: more threads only wait

import numpy as np
from gymnasium import spaces

import gamekeeper as gk
from gamekeeper.statistics.one_sample import one_sample

PLACES: Final = 9
TICKS: Final = 15
MOVES: Final = {"walker": (-1, 0, 1), "runner": (-2, -1, 0, 1, 2)}
STEPS: Final = 30_000
"""Ticks that are learnt from; half of them before the algorithm is saved and restored."""
QUICK: Final = 4_000
GAMES: Final = 200
WANTED: Final = 0.7
"""Mean return of an agent, stated before the first training: see `--play`."""
FRESH: Final = 1_000_000
"""Seed of the games that are judged."""
SPEC: Final = f"{__file__}:Corridor"


class Corridor(gk.TickEnv):
    """A walker and a runner on their ways to two lamps."""

    metadata = {"name": "corridor_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self) -> None:
        super().__init__(horizon=TICKS)
        self.possible_agents = list(MOVES)
        self.observation_spaces = dict.fromkeys(MOVES, spaces.Box(0, 1, (4,), np.float32))
        self.action_spaces = {agent: spaces.Discrete(len(MOVES[agent])) for agent in MOVES}

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Draws two places, and a lamp for each elsewhere than where it stands."""
        runner = int(rng.integers(PLACES))
        self.at = {"walker": elsewhere(rng, runner), "runner": runner}
        self.lamp = {agent: elsewhere(rng, self.at[agent]) for agent in MOVES}

    def tick(self, actions: dict[str, Any]) -> None:
        """The walker goes first; a place that is taken by then isn't entered."""
        for agent in [one for one in MOVES if one in actions]:
            to = self.at[agent] + MOVES[agent][int(actions[agent])]
            if self.is_free(agent, to):
                self.at[agent] = to
            self.add_reward(agent, -0.05, term="time")
            if self.at[agent] == self.lamp[agent]:
                self.add_reward(agent, 1.0, term="arrival")
                self.terminate(agent, "arrived")

    def is_free(self, agent: str, to: int) -> bool:
        """Whether an agent may stand there; one that has arrived is out of the way."""
        others = [self.at[one] for one in self.agents if one != agent]
        return 0 <= to < PLACES and to not in others

    def observe(self, agent: str) -> Any:
        """Own place and lamp, the other's place, and whether it is still there."""
        other = next(one for one in MOVES if one != agent)
        is_there = other in self.agents
        found = [self.at[agent], self.lamp[agent], self.at[other] * is_there]
        return np.array([*(np.array(found) / (PLACES - 1)), is_there], np.float32)

    def mask(self, agent: str) -> Any:
        """Moves to places that are free now."""
        free = [self.is_free(agent, self.at[agent] + move) for move in MOVES[agent]]
        return np.array(free, np.int8)


def elsewhere(rng: Any, place: int) -> int:
    """Any place but this one."""
    return int(place + 1 + rng.integers(PLACES - 1)) % PLACES


def nearer(observation: Any, agent: str, info: Any, rng: Any) -> int:
    """The allowed move that ends nearest to the lamp, of two the longer one: plays by hand."""
    away = np.rint((observation[1] - observation[0]) * (PLACES - 1))
    moves, is_barred = np.array(MOVES[agent]), info["action_mask"] == 0
    return int(np.argmin(np.abs(away - moves) - 0.1 * np.abs(moves) + PLACES * is_barred))


def config(seed: int) -> Any:
    """PPO in this process, with a masked module for each role."""
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from gamekeeper.adapters import rllib

    network = DefaultModelConfig(fcnet_hiddens=[64, 64])
    return (
        PPOConfig()
        .environment(rllib.register(SPEC, seed=seed), disable_env_checking=True)
        .env_runners(num_env_runners=0, num_envs_per_env_runner=16)
        .multi_agent(**rllib.policy_mapping(SPEC))
        .rl_module(rl_module_spec=rllib.modules(SPEC, model_config=network))
        .training(
            lr=1e-3,
            train_batch_size_per_learner=1_500,
            minibatch_size=250,
            num_epochs=6,
            entropy_coeff=0.01,
            gamma=0.95,
            lambda_=0.9,
        )
        .callbacks(rllib.ReturnsCallback)
        .debugging(seed=seed)
    )


def learn(seed: int, steps: int, folder: Path) -> Path:
    """Learns in two halves, the second by an algorithm that is restored from the first one's file.

    Returns:
        The last checkpoint.
    """
    checkpoint = None
    for half in (1, 2):
        algorithm = config(seed + 1_000 * (half - 1)).build_algo()
        if checkpoint is not None:
            algorithm.restore_from_path(str(checkpoint))
        done = 0
        while done < steps * half // 2:
            found = algorithm.train()["env_runners"]
            done = int(found["num_env_steps_sampled_lifetime"])
            roles = {r: round(float(paid), 3) for r, paid in found["gamekeeper"]["role"].items()}
            print({"steps": done, **roles}, file=sys.stderr)
        checkpoint = Path(algorithm.save_to_path(str(folder / f"half_{half}")))
        algorithm.stop()
    return checkpoint


def judge(policies: Any, games: int, out: Path | None = None) -> list[float]:
    """Mean return of an agent in each of some games that weren't learnt from."""
    played = gk.rollout(SPEC, policies=policies, episodes=games, seed=FRESH, out=out)
    rows = played.agent_steps.group_by("episode").aggregate([("reward", "sum")]).to_pydict()
    return [paid / len(MOVES) for paid in rows["reward_sum"]]


def main() -> int:
    """Learns with one seed and prints what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a short run that shows that it runs")
    parser.add_argument("--play", action="store_true", help="no learning: random play, and by hand")
    given = parser.parse_args()
    games = GAMES // 2 if given.quick else GAMES
    chance = float(np.mean(judge("random", games)))
    if given.play:
        hand = float(np.mean(judge(nearer, games)))
        print(json.dumps({"random": round(chance, 3), "by_hand": round(hand, 3)}))
        return 0
    import ray

    from gamekeeper.adapters import rllib

    began_s = time.perf_counter()
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        checkpoint = learn(given.seed, QUICK if given.quick else STEPS, folder)
        ray.shutdown()
        found = judge(f"rllib:{checkpoint}", games, folder / "run")
        is_replayed = gk.replay(folder / "run").verified
    result, shown = float(np.mean(found)), one_sample(found, rng=np.random.default_rng(0))
    line = {
        "example": "rllib_own",
        "trainer": f"rllib {rllib.VERSION}",
        "seed": given.seed,
        "steps": QUICK if given.quick else STEPS,
        "seconds": round(time.perf_counter() - began_s, 1),
        "measure": "mean return of an agent",
        "result": round(result, 3),
        "interval": [round(shown.low, 3), round(shown.high, 3)],
        "random": round(chance, 3),
        "replayed": is_replayed,
        "wanted": WANTED,
        "reached": result >= WANTED,
    }
    print(json.dumps(line))
    return 0 if is_replayed and (given.quick or result >= WANTED) else 1


if __name__ == "__main__":
    sys.exit(main())
