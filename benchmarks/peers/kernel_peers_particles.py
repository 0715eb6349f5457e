"""Peers of the kernel `spread`, each run by a Python that has it; benchmarks/kernels.py calls this.

PATH/bin/python benchmarks/peers/kernel_peers_particles.py jaxmarl --envs 1024 --seconds 2

Three agents, 25 ticks an episode, discrete actions drawn beforehand, observations written. The last
line printed is JSON: agent-steps a second, the best of five parts. A peer that isn't installed says
so there.
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
TASK: Final = "spread"
AGENTS, MOVES, TICKS = 3, 5, 25
PARTS: Final = 5


def jaxmarl(envs: int) -> Callable[[], int]:
    """JaxMARL's MPE_simple_spread_v3 on the processor: an episode is a compiled scan of a vmap."""
    import jax
    import jaxmarl

    env = jaxmarl.make("MPE_simple_spread_v3")
    keys = jax.random.split(jax.random.PRNGKey(0), envs)
    _, first = jax.jit(jax.vmap(env.reset))(keys)
    drawn = jax.random.randint(jax.random.PRNGKey(1), (TICKS, AGENTS, envs), 0, MOVES)

    def tick(state: Any, given: tuple[Any, Any]) -> tuple[Any, Any]:
        key, actions = given
        by_agent = dict(zip(env.agents, actions, strict=True))
        obs, state, rewards, dones, _ = jax.vmap(env.step)(
            jax.random.split(key, envs), state, by_agent
        )
        return state, (obs, rewards, dones)

    @jax.jit
    def episode(state: Any, key: Any) -> Any:
        return jax.lax.scan(tick, state, (jax.random.split(key, TICKS), drawn))

    states = {"now": first, "number": 0}

    def run() -> int:
        states["number"] += 1
        states["now"], told = episode(states["now"], jax.random.PRNGKey(states["number"]))
        jax.block_until_ready(told)
        return TICKS * envs * AGENTS

    return run


def vmas(envs: int) -> Callable[[], int]:
    """VMAS's simple_spread on the processor; it is reset after the episode's last tick."""
    import torch
    from vmas import make_env

    env = make_env("simple_spread", num_envs=envs, device="cpu", continuous_actions=False, seed=0)
    env.reset()
    torch.manual_seed(0)
    drawn = torch.randint(0, MOVES, (TICKS, AGENTS, envs, 1))

    def run() -> int:
        for actions in drawn:
            env.step(list(actions))
        env.reset()
        return TICKS * envs * AGENTS

    return run


def mpe2(envs: int) -> Callable[[], int]:
    """The Python original, as many environments one after the other."""
    import numpy as np
    from mpe2 import simple_spread_v3

    many = [simple_spread_v3.parallel_env(max_cycles=TICKS) for _ in range(envs)]
    for number, env in enumerate(many):
        env.reset(seed=number)
    drawn = np.random.default_rng(0).integers(0, MOVES, (TICKS, envs, AGENTS))

    def run() -> int:
        for actions in drawn:
            for env, joint in zip(many, actions, strict=True):
                env.step(dict(zip(env.agents, joint, strict=True)))
        for env in many:
            env.reset()
        return TICKS * envs * AGENTS

    return run


PEERS: Final = {"jaxmarl": jaxmarl, "vmas": vmas, "mpe2": mpe2}


def one_thread() -> None:
    """Peers that would take every core are told to take one, before they are imported."""
    flags = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flags}"
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def main() -> None:
    """Measures one peer at one batch size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("peer", choices=PEERS)
    parser.add_argument("--envs", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each of five parts")
    parser.add_argument("--threads", type=int, choices=(0, 1), default=1, help="0: all it takes")
    asked = parser.parse_args()
    if asked.threads:
        one_thread()
    line = {"task": TASK, "subject": asked.peer, "envs": asked.envs, "threads": asked.threads}
    try:
        with contextlib.redirect_stdout(sys.stderr):  # peers talk as they are imported
            run = PEERS[asked.peer](asked.envs)
    except ImportError as error:
        print(json.dumps({**line, "missing": str(error)}))
        sys.exit(0)
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
