"""Peers of `gk.vector`, each run by a Python that has it; see benchmarks/vector.py.

PATH/bin/python benchmarks/peers/vector_peers.py supersuit_0 --task spread --seconds 4
"""

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

warnings.simplefilter("ignore")
COPIES: Final = 64
WARM: Final = 8


TASKS: Final = {"rware": "rware:rware-tiny-2ag-v2", "line": "two_robot_line"}
BENCHMARKS: Final = str(Path(__file__).parents[1])


def environment(task: str) -> Any:
    """The same environment as a PettingZoo ParallelEnv."""
    if task == "spread":
        from mpe2 import simple_spread_v3

        return simple_spread_v3.parallel_env()
    if task == "textbook":
        sys.path.insert(0, BENCHMARKS)
        from textbook_line import parallel_env

        return parallel_env()
    import gamekeeper as gk

    return gk.make(TASKS[task], slim=False)


def supersuit_0(task: str) -> Callable[[int], int]:
    """SuperSuit's concatenated vector environment in one process."""
    return _supersuit(task, 0)


def supersuit_2(task: str) -> Callable[[int], int]:
    """SuperSuit's concatenated vector environment in two processes."""
    return _supersuit(task, 2)


def _supersuit(task: str, cpus: int) -> Callable[[int], int]:
    import supersuit

    one = supersuit.pettingzoo_env_to_vec_env_v1(environment(task))
    venv = supersuit.concat_vec_envs_v1(one, COPIES, num_cpus=cpus, base_class="gymnasium")
    venv.reset(seed=0)
    space = venv.single_action_space if hasattr(venv, "single_action_space") else venv.action_space
    space.seed(0)
    count = venv.num_envs
    import numpy as np

    drawn = [np.array([space.sample() for _ in range(count)]) for _ in range(16)]

    def step(number: int) -> int:
        venv.step(drawn[number % 16])
        return int(count)

    return step


def agilerl(task: str) -> Callable[[int], int]:
    """AgileRL's vector environment: a process for each copy."""
    from agilerl.vector.pz_async_vec_env import AsyncPettingZooVecEnv

    venv = AsyncPettingZooVecEnv([lambda: environment(task)] * COPIES)
    venv.reset(seed=0)
    agents = list(venv.agents)
    import numpy as np

    spaces = {agent: venv.single_action_space(agent) for agent in agents}
    drawn = [
        {a: np.array([space.sample() for _ in range(COPIES)]) for a, space in spaces.items()}
        for _ in range(16)
    ]

    def step(number: int) -> int:
        venv.step(drawn[number % 16])
        return COPIES * len(agents)

    return step


def main() -> None:
    """Measures one subject and prints a line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("subject", choices=["supersuit_0", "supersuit_2", "agilerl"])
    parser.add_argument("--task", required=True)
    parser.add_argument("--seconds", type=float, default=4.0)
    arguments = parser.parse_args()
    step = globals()[arguments.subject](arguments.task)
    for number in range(WARM):
        step(number)
    done, number, begun_s = 0, WARM, time.perf_counter()
    while time.perf_counter() - begun_s < arguments.seconds:
        done += step(number)
        number += 1
    print(json.dumps({"agent_steps_s": round(done / (time.perf_counter() - begun_s))}))


if __name__ == "__main__":
    main()
