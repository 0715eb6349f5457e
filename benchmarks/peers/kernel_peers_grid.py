"""Peers of the kernels `robotic_warehouse` and `foraging`; benchmarks/kernels.py calls this.

PATH/bin/python benchmarks/peers/kernel_peers_grid.py jumanji --task foraging --envs 1024

robotic_warehouse: the tiny layout, four robots, four requests, 500 ticks. foraging: eight by eight
cells, two players who see everything, three pieces of food, 50 ticks. Actions are drawn beforehand,
observations written, episodes that end begin anew. Prints a JSON line: agent-steps a second, the
best of five parts. A peer that isn't installed says so.

Jumanji's rules differ. Its RobotWarehouse ends an episode where two robots collide, pays all robots
together, and puts actions that are masked out aside; its LevelBasedForaging places players and food
otherwise. rware and lbforaging are the originals, in Python, with which our kernels agree step by
step.
"""

import argparse
import contextlib
import json
import os
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any, Final

warnings.simplefilter("ignore")
TICKS: Final = 32
"""Of a scan, or between two looks at the clock."""
PARTS: Final = 5
AGENTS: Final = {"robotic_warehouse": 4, "foraging": 2}
ACTIONS: Final = {"robotic_warehouse": 5, "foraging": 6}


def jumanji(task: str, envs: int) -> Callable[[], int]:
    """Jumanji on the processor: ticks are a compiled scan of a vmap, with its own autoreset."""
    import jax
    from jumanji.environments import LevelBasedForaging, RobotWarehouse
    from jumanji.environments.routing.lbf.generator import RandomGenerator as Fields
    from jumanji.environments.routing.robot_warehouse.generator import RandomGenerator as Floors
    from jumanji.wrappers import VmapAutoResetWrapper

    made = (
        RobotWarehouse(
            generator=Floors(
                shelf_rows=1,
                shelf_columns=3,
                column_height=8,
                num_agents=4,
                sensor_range=1,
                request_queue_size=4,
            ),
            time_limit=500,
        )
        if task == "robotic_warehouse"
        else LevelBasedForaging(
            generator=Fields(grid_size=8, num_agents=2, num_food=3, fov=8), time_limit=50
        )
    )
    env = VmapAutoResetWrapper(made)
    first, _ = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), envs))
    drawn = jax.random.randint(jax.random.PRNGKey(1), (TICKS, envs, AGENTS[task]), 0, ACTIONS[task])

    @jax.jit
    def ticks(state: Any) -> Any:
        return jax.lax.scan(env.step, state, drawn)

    states = {"now": first}

    def run() -> int:
        states["now"], told = ticks(states["now"])
        jax.block_until_ready(told)
        return TICKS * envs * AGENTS[task]

    return run


def rware(task: str, envs: int) -> Callable[[], int]:
    """The Python original, as many environments one after the other."""
    import gymnasium
    import rware  # noqa: F401  # registers its ids

    return one_by_one(task, [gymnasium.make("rware-tiny-4ag-v2") for _ in range(envs)])


def lbforaging(task: str, envs: int) -> Callable[[], int]:
    """The Python original, as many environments one after the other."""
    import gymnasium
    import lbforaging  # noqa: F401  # registers its ids

    return one_by_one(task, [gymnasium.make("Foraging-8x8-2p-3f-v3") for _ in range(envs)])


def one_by_one(task: str, wrapped: list[Any]) -> Callable[[], int]:
    """What plays these environments by turns, without Gymnasium's wrappers."""
    import numpy as np

    many = [env.unwrapped for env in wrapped]
    for number, env in enumerate(many):
        env.reset(seed=number)
    shape = TICKS, len(many), AGENTS[task]
    drawn = np.random.default_rng(0).integers(0, ACTIONS[task], shape).tolist()

    def run() -> int:
        for joint in drawn:
            for env, actions in zip(many, joint, strict=True):
                if env.step(actions)[2]:
                    env.reset()
        return TICKS * len(many) * AGENTS[task]

    return run


PEERS: Final = {
    "jumanji": (jumanji, ("robotic_warehouse", "foraging")),
    "rware": (rware, ("robotic_warehouse",)),
    "lbforaging": (lbforaging, ("foraging",)),
}


def one_thread() -> None:
    """Peers that would take every core are told to take one, before they are imported."""
    flags = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flags}"
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def main() -> None:
    """Measures one peer of one task at one batch size."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("peer", choices=PEERS)
    parser.add_argument("--task", choices=AGENTS, required=True)
    parser.add_argument("--envs", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each of five parts")
    parser.add_argument("--threads", type=int, choices=(0, 1), default=1, help="0: all it takes")
    asked = parser.parse_args()
    make, tasks = PEERS[asked.peer]
    if asked.task not in tasks:
        parser.error(f"{asked.peer} has no {asked.task}")
    if asked.threads:
        one_thread()
    line = {"task": asked.task, "subject": asked.peer, "envs": asked.envs, "threads": asked.threads}
    try:
        with contextlib.redirect_stdout(sys.stderr):  # peers talk as they are imported
            run = make(asked.task, asked.envs)
    except ImportError as error:
        print(json.dumps({**line, "missing": str(error)}))
        return
    run()  # compiles
    best = 0.0
    for _ in range(PARTS):
        start, steps = time.perf_counter(), 0
        while time.perf_counter() - start < asked.seconds:
            steps += run()
        best = max(best, steps / (time.perf_counter() - start))
    print(json.dumps({**line, "agent_steps_per_s": round(best)}))


if __name__ == "__main__":
    main()
