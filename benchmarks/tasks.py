"""How often the scripted policies solve our tasks, with intervals, and what a step costs.

Prints a JSON line for each task, policy and setting of knobs: the share of solved episodes with its
Wilson interval (95 %), mean return of an agent, mean ticks or turns, microseconds of processor time
for each agent-step (policy included). Episode k has seed `--seed` + k.

    python benchmarks/tasks.py [--tasks warehouse,warehouse_turns]
        [--policies reference,greedy,lazy] [--episodes 500] [--seed 0] [--knobs]
        [--kwargs '{"layout": "wide"}']

`--knobs` measures each knob by itself as well, at the strength that stands in KNOBS.
"""

import argparse
import importlib
import json
import math
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

KNOBS: dict[str, float] = {
    "observation_noise": 0.5,
    "occlusion": 0.3,
    "observation_delay": 2,
    "odometry_drift": 0.1,
    "actuator_slip": 0.2,
    "actuator_dropout": 0.2,
    "latency": 1,
    "slowness": 1,
    "held_out": 1.0,
}


@dataclass(frozen=True, slots=True)
class Task:
    """One of our tasks, and the ending by which an episode is told to be solved."""

    place: str
    solved: str


TASKS = {
    "handover": Task("gamekeeper.tasks.handover.handover:Handover", "done"),
    "pursuit": Task("gamekeeper.tasks.pursuit.pursuit:Pursuit", "cleared"),
    "two_robot_line": Task("gamekeeper.tasks.two_robot_line:TwoRobotLine", "met"),
    "warehouse": Task("gamekeeper.tasks.warehouse.warehouse:Warehouse", "cleared"),
    "warehouse_turns": Task("gamekeeper.tasks.warehouse.warehouse_turns:WarehouseTurns", "cleared"),
}


def wilson(solved: int, episodes: int, z: float = 1.959964) -> tuple[float, float]:
    """The interval of a share.

    Source: Wilson 1927, "Probable inference, the law of succession, and statistical inference".
    """
    share, weight = solved / episodes, z * z / episodes
    middle = (share + weight / 2) / (1 + weight)
    half = z / (1 + weight) * math.sqrt(share * (1 - share) / episodes + weight / (4 * episodes))
    return max(0.0, middle - half), min(1.0, middle + half)


def play_ticks(env: Any, policy: Any, seed: int) -> tuple[int, float]:
    """A Parallel episode: agent-steps, and the sum of all rewards."""
    rng = np.random.default_rng(seed)
    observations, infos = env.reset(seed=seed)
    steps, total = 0, 0.0
    while env.agents:
        actions = {a: policy(observations[a], a, infos[a], rng) for a in env.agents}
        steps += len(actions)
        observations, rewards, _, _, infos = env.step(actions)
        total += sum(rewards.values())
    return steps, total


def play_turns(env: Any, policy: Any, seed: int) -> tuple[int, float]:
    """An AEC episode: agent-steps, and the sum of all rewards."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    steps, total = 0, 0.0
    for agent in env.agent_iter():
        seen, _, terminated, truncated, info = env.last()
        if terminated or truncated:
            env.step(None)
            continue
        steps += 1
        env.step(policy(seen, agent, info, rng))
        total += sum(env.rewards[paid] for paid in env.touched.paid)
    return steps, total


def measure(name: str, policy: str, episodes: int, seed: int, given: dict[str, Any]) -> Any:
    """The line of one task under one policy."""
    task = TASKS[name]
    module, _, kind = task.place.partition(":")
    env = getattr(importlib.import_module(module), kind)(**given)
    play = play_ticks if hasattr(env, "tick") else play_turns
    solved, steps, spent, returns, lengths = 0, 0, 0.0, [], []
    for episode in range(episodes):
        begun = time.process_time()
        played, total = play(env, type(env).policies[policy], seed + episode)
        spent += time.process_time() - begun
        steps += played
        solved += task.solved in env.endings.values()
        returns.append(total / len(env.endings))
        lengths.append(env.turns)
    low, high = wilson(solved, episodes)
    return {
        "task": name,
        "policy": policy,
        "kwargs": given,
        "episodes": episodes,
        "seed": seed,
        "solved": solved / episodes,
        "low": round(low, 4),
        "high": round(high, 4),
        "return_mean": round(statistics.fmean(returns), 3),
        "length_mean": round(statistics.fmean(lengths), 1),
        "agent_step_us": round(spent / steps * 1e6, 1),
    }


def settings(name: str, given: dict[str, Any], with_knobs: bool) -> Iterator[dict[str, Any]]:
    """The arguments to measure a task under: as given, then each knob that it has."""
    yield given
    module, _, kind = TASKS[name].place.partition(":")
    form = getattr(importlib.import_module(module), kind)(**given).declared
    for knob in form.knobs if with_knobs else ():
        yield {**given, knob: KNOBS[knob]}


def main() -> None:
    """Measures what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--policies", default="reference,greedy,lazy")
    parser.add_argument("--episodes", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--knobs", action="store_true")
    parser.add_argument("--kwargs", type=json.loads, default={})
    asked = parser.parse_args()
    for name in asked.tasks.split(","):
        for policy in asked.policies.split(","):
            for given in settings(name, asked.kwargs, asked.knobs):
                line = measure(name, policy, asked.episodes, asked.seed, given)
                print(json.dumps(line), flush=True)


if __name__ == "__main__":
    sys.exit(main())
