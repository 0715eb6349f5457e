"""An environment of one's own, seen as a picture and numbers, learnt with Stable-Baselines3.

Needs `pip install 'gamekeeper[sb3]'`. Two gatherers each stand in a lane of seven places and are
paid 1 for reaching the place that is bright in their picture, less 0.05 a tick; one that has
arrived has ended, after 12 ticks the other is cut off. Two ways to learn it:

    python examples/sb3_own.py --way dict     # MaskablePPO: picture and numbers in a Dict, masks
    python examples/sb3_own.py --way image    # DQN: the picture alone, no masks

Either learns half of its steps, is saved, loaded into a new environment, learns on, is saved again,
plays 200 games that it didn't learn from out of the file, which are recorded and replayed. Options:
`--seed 0`, `--quick`. One JSON line; exit status 1 if the wanted result isn't reached.
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
from gymnasium import spaces

import gamekeeper as gk
from gamekeeper.statistics.one_sample import one_sample

PLACES: Final = 7
TICKS: Final = 12
PIXELS: Final = 6  # a side of a place in the picture
HEIGHT: Final = 36
WIDTH: Final = (
    44  # with a border: Stable-Baselines3's network reads 36, 44, 52, ... columns, no more
)
STEPS: Final = 30_000
"""Of all agents; half of them before the model is saved and loaded."""
QUICK: Final = 1_200
GAMES: Final = 200
WANTED: Final = 0.75
"""Mean return of an agent, stated before the first run; the shortest ways get 0.87."""
UNSEEN: Final = 1_000_000
"""Seed of the run that is judged."""


class Lanes(gk.TickEnv):
    """Two gatherers, each in a lane of its own."""

    metadata = {"name": "lanes_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, way: str = "dict") -> None:
        super().__init__(horizon=TICKS)
        self.way = way
        self.possible_agents = ["gatherer_0", "gatherer_1"]
        picture = spaces.Box(0, 255, (HEIGHT, WIDTH, 1), np.uint8)
        numbers = spaces.Box(0, 1, (2,), np.float32)
        seen = spaces.Dict({"picture": picture, "numbers": numbers}) if way == "dict" else picture
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(3))

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Draws where each stands and where its light is, another place."""
        self.at, self.light = {}, {}
        for agent in self.possible_agents:
            self.at[agent] = rng.integers(PLACES)
            self.light[agent] = (self.at[agent] + 1 + rng.integers(PLACES - 1)) % PLACES

    def tick(self, actions: dict[str, Any]) -> None:
        """Everybody goes left, stays or goes right."""
        for agent, action in actions.items():
            self.at[agent] = min(max(self.at[agent] + int(action) - 1, 0), PLACES - 1)
            self.add_reward(agent, -0.05, term="time")
            if self.at[agent] == self.light[agent]:
                self.add_reward(agent, 1.0, term="arrival")
                self.terminate(agent, "arrived")

    def observe(self, agent: str) -> Any:
        """The lane as a picture: the light above, the agent below; and its place in numbers."""
        picture = np.zeros((HEIGHT, WIDTH, 1), np.uint8)
        for rows, place in ((slice(0, 18), self.light[agent]), (slice(18, 36), self.at[agent])):
            picture[rows, 1 + place * PIXELS : 1 + (place + 1) * PIXELS] = 255
        if self.way != "dict":
            return picture
        return {"picture": picture, "numbers": np.array([self.at[agent] / 6, 1], np.float32)}

    def mask(self, agent: str) -> Any:
        """No step over the ends of a lane; DQN reads no masks, and stays where it is there."""
        if self.way != "dict":
            return None
        return np.array([self.at[agent] > 0, 1, self.at[agent] < PLACES - 1], np.int8)


def make_model(way: str, venv: Any, seed: int) -> Any:
    """A learner that hasn't learnt yet."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3 import DQN

    from gamekeeper.adapters import sb3

    common = {"gamma": 0.95, "device": "cpu", "seed": seed}
    if way == "dict":
        sizes = {
            "n_steps": 32,
            "batch_size": 128,
            "n_epochs": 10,
            "learning_rate": 5e-4,
            "ent_coef": 0.01,
        }
        more = sb3.buffer(venv, masked=True)
        return MaskablePPO("MultiInputPolicy", venv, **sizes, **common, **more)
    sizes = {"buffer_size": 30_000, "batch_size": 64, "learning_rate": 5e-4}
    when = {"learning_starts": 1_000, "train_freq": 1, "gradient_steps": 2}
    explores = {"exploration_fraction": 0.5, "target_update_interval": 500}
    more = sb3.replay_buffer(venv)
    return DQN("CnnPolicy", venv, **sizes, **when, **explores, **common, **more)


def learn(way: str, seed: int, steps: int, folder: Path) -> Path:
    """Learns in two halves, with a file in between; returns the file of the model."""
    from gamekeeper.adapters import sb3

    spec, kwargs = f"{__file__}:Lanes", {"way": way}
    venv = sb3.vec_env(spec, 16, seed=seed, env_kwargs=kwargs)
    model = make_model(way, venv, seed)
    model.learn(steps // 2)
    file = sb3.save(model, folder / "half")
    if way == "image":
        model.save_replay_buffer(folder / "replay.pkl")
    venv.close()

    venv = sb3.vec_env(spec, 16, seed=seed + 1_000, env_kwargs=kwargs)
    more = sb3.buffer(venv, masked=True) if way == "dict" else sb3.replay_buffer(venv)
    model = type(model).load(file, env=venv, device="cpu", **more)
    if way == "image":
        model.load_replay_buffer(folder / "replay.pkl")
        model.replay_buffer.watch(venv)
    model.learn(steps - steps // 2, reset_num_timesteps=False)
    venv.close()
    return sb3.save(model, folder / "whole")


def judge(way: str, policy: Any, games: int, out: Path | None = None) -> list[float]:
    """Mean return of an agent in each of some games that weren't learnt from."""
    played = gk.rollout(
        f"{__file__}:Lanes",
        policies=policy,
        episodes=games,
        seed=UNSEEN,
        out=out,
        env_kwargs={"way": way},
    )
    rows = played.agent_steps.group_by("episode").aggregate([("reward", "sum")]).to_pydict()
    return [paid / 2 for paid in rows["reward_sum"]]


def main() -> int:
    """Learns with one seed and prints what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--way", choices=("dict", "image"), default="dict")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a short run that shows that it runs")
    given = parser.parse_args()
    import stable_baselines3
    import torch

    torch.set_num_threads(1)
    began_s = time.perf_counter()
    games = GAMES // 4 if given.quick else GAMES
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = learn(given.way, given.seed, QUICK if given.quick else STEPS, folder)
        found = judge(given.way, f"sb3:{file}", games, folder / "run")
        replay = gk.replay(folder / "run")
    chance = judge(given.way, "random", games)
    result = float(np.mean(found))
    shown = None if given.quick else one_sample(found, rng=np.random.default_rng(0))
    line = {
        "example": "sb3_own",
        "trainer": f"stable-baselines3 {stable_baselines3.__version__}",
        "way": given.way,
        "seed": given.seed,
        "seconds": round(time.perf_counter() - began_s, 1),
        "measure": "mean return of an agent",
        "result": round(result, 3),
        "interval": shown and [round(shown.low, 3), round(shown.high, 3)],
        "random": round(float(np.mean(chance)), 3),
        "replayed": replay.verified,
        "wanted": WANTED,
        "reached": result >= WANTED,
    }
    print(json.dumps(line))
    return 0 if replay.verified and (given.quick or result >= WANTED) else 1


if __name__ == "__main__":
    sys.exit(main())
