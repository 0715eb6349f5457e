"""Kernels on a CUDA device beside JaxMARL and Jumanji on the same device.

Prints a JSON line for each subject, task and number of copies: agent-steps a second, the best of
five parts, and for ours how much of the device's memory bandwidth that is: bytes that a step has to
read and write (state both, actions read, all that is shown written), against a copy of a gigabyte
measured beside it. Random actions are drawn beforehand and observations written in every step; ours
judges every action (`checks="later"`), episodes begin anew by themselves.

    python benchmarks/on_cuda.py [--tasks spread,robotic_warehouse] [--copies 4096,65536]
        [--peer PYTHON]... [--seconds 1]

`--peer` names a Python that has jax with CUDA, and jaxmarl or jumanji; what isn't there is said in
a line with `missing`. Without a device the script says so and exits with 2.

What differs: JaxMARL computes in float32, ours in float64; in Jumanji's RobotWarehouse a collision
ends the episode, and ours draws its episodes as RWARE does. Peers scan over many steps inside one
compiled call; ours starts each step from Python.
"""

import argparse
import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

PARTS: Final = 5
STEPS: Final = 100
"""Ticks that a peer scans over in one call."""
SETS: Final = 8
"""Arrays of actions that are drawn beforehand."""
TASKS: Final = {
    "two_robot_line": {},
    "spread": {"N": 3},
    "robotic_warehouse": {"layout": "tiny", "n_agents": 4},
}
COPIES: Final = "4096,65536,1048576"
GIGABYTE: Final = 1 << 30


def best_rate(run: Callable[[], int], seconds: float) -> float:
    """Agent-steps a second in the best of five parts; `run` returns how many it did."""
    run()  # compiles
    rates = []
    for _ in range(PARTS):
        done, begun = 0, time.perf_counter()
        while (spent := time.perf_counter() - begun) < seconds / PARTS or not done:
            done += run()
        rates.append(done / (time.perf_counter() - begun) if spent else 0.0)
    return max(rates)


# Ours


def ours(task: str, copies: int, seconds: float) -> dict[str, Any]:
    """A batch on the device."""
    import numpy as np
    from numba import cuda

    import gamekeeper as gk
    from gamekeeper.kernels.cuda import CudaBatch

    kernel = gk.make(task, **TASKS[task]).kernel
    begun = time.perf_counter()
    batch = CudaBatch(kernel, copies, checks="later")
    batch.reset()
    compile_s = time.perf_counter() - begun
    rng, a = np.random.default_rng(0), batch.arrays
    space = kernel.groups[0].action_space
    drawn = [
        cuda.to_device(rng.integers(space.n, size=a.actions.shape).astype(a.actions.dtype))
        for _ in range(SETS)
    ]

    def run() -> int:
        for actions in drawn:
            batch.step(actions)
        cuda.synchronize()
        return SETS * copies * len(kernel.agents)

    rate = best_rate(run, seconds)
    batch.check()
    shown = (a.obs, a.masks, a.rewards, a.terminated, a.truncated, a.live, a.over, a.ended)
    moved = 2 * batch.records.nbytes + a.actions.nbytes + sum(array.nbytes for array in shown)
    steps = rate / copies / len(kernel.agents)
    return {
        "rate": rate,
        "bytes_a_copy": moved / copies,
        "bandwidth": moved * steps / bandwidth(),
        "compile_s": round(compile_s, 2),
    }


def bandwidth() -> float:
    """Bytes a second that a copy on the device reads and writes, the best of five."""
    import numpy as np
    from numba import config, cuda

    size = GIGABYTE >> (10 if config.ENABLE_CUDASIM else 0)
    source = cuda.to_device(np.zeros(size, np.uint8))
    target, best = cuda.device_array_like(source), float("inf")
    for _ in range(PARTS + 1):
        begun = time.perf_counter()
        target.copy_to_device(source)
        cuda.synchronize()
        best = min(best, time.perf_counter() - begun)
    return 2 * size / best


# Peers, in a Python of their own


def jaxmarl(copies: int) -> Callable[[], int]:
    """JaxMARL's MPE_simple_spread_v3: a compiled scan of a vmap, which begins episodes anew."""
    import jax
    import jaxmarl as peer

    env = peer.make("MPE_simple_spread_v3")
    agents = len(env.agents)
    drawn = jax.random.randint(jax.random.PRNGKey(1), (STEPS, agents, copies), 0, 5)

    def tick(state: Any, given: Any) -> Any:
        key, actions = given
        joint = dict(zip(env.agents, actions, strict=True))
        obs, state, rewards, ended, _ = jax.vmap(env.step)(
            jax.random.split(key, copies), state, joint
        )
        return state, (_sums(obs), _sums(rewards), _sums(ended))

    @jax.jit
    def play(state: Any, key: Any) -> Any:
        return jax.lax.scan(tick, state, (jax.random.split(key, STEPS), drawn))

    _, state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.PRNGKey(0), copies))
    return _runner(play, state, copies * agents)


def jumanji(copies: int) -> Callable[[], int]:
    """Jumanji's RobotWarehouse-v0, 4 robots: a compiled scan of a vmap, begun anew by a wrapper."""
    import jax
    import jumanji as peer
    from jumanji.wrappers import VmapAutoResetWrapper

    env = VmapAutoResetWrapper(peer.make("RobotWarehouse-v0"))
    agents = int(env.action_spec.shape[0])
    drawn = jax.random.randint(jax.random.PRNGKey(1), (STEPS, copies, agents), 0, 5)

    def tick(state: Any, actions: Any) -> Any:
        state, told = env.step(state, actions)
        return state, _sums(told)

    @jax.jit
    def play(state: Any, key: Any) -> Any:
        return jax.lax.scan(tick, state, drawn)

    state, _ = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), copies))
    return _runner(play, state, copies * agents)


def _sums(told: Any) -> Any:
    """Sums of all that is told: a scan that keeps every observation would fill the device."""
    import jax

    return jax.tree_util.tree_map(lambda leaf: leaf.sum(), told)


def _runner(play: Callable[..., Any], state: Any, wide: int) -> Callable[[], int]:
    import jax

    held = {"state": state, "number": 0}

    def run() -> int:
        held["number"] += 1
        held["state"], told = play(held["state"], jax.random.PRNGKey(held["number"]))
        jax.block_until_ready(told)
        return STEPS * wide

    return run


PEERS: Final = {"jaxmarl": ("spread", jaxmarl), "jumanji": ("robotic_warehouse", jumanji)}


def measure_peer(peer: str, copies: int, seconds: float) -> dict[str, Any]:
    """One peer; `missing` where it, or its device, isn't there."""
    try:
        with contextlib.redirect_stdout(sys.stderr):
            import jax

            if jax.default_backend() not in ("gpu", "cuda"):
                return {"missing": f"jax computes on {jax.default_backend()}"}
            return {"rate": best_rate(PEERS[peer][1](copies), seconds)}
    except Exception as error:
        return {"missing": f"{type(error).__name__}: {error}"[:300]}


def lines(asked: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A line for each subject, task and number of copies."""
    device = {"device": device_name()}
    for task in asked.tasks.split(","):
        for copies in map(int, asked.copies.split(",")):
            here = {"task": task, "copies": copies, **device}
            yield {"subject": "gamekeeper", **here, **ours(task, copies, asked.seconds)}
            for python in asked.peer:
                for peer in (name for name, (of, _) in PEERS.items() if of == task):
                    command = [python, __file__, "--one", peer, "--copies", str(copies)]
                    command += ["--seconds", str(asked.seconds)]
                    done = subprocess.run(command, capture_output=True, text=True, check=False)
                    told = done.stdout.strip().splitlines()
                    found = json.loads(told[-1]) if told else {"missing": done.stderr[-300:]}
                    yield {"subject": peer, **here, **found}


def device_name() -> str:
    """What computes here."""
    from numba import config, cuda

    if config.ENABLE_CUDASIM:
        return "Numba's simulator: these figures say nothing"
    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


def main() -> int:
    """Measures, or says what is missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--copies", default=COPIES)
    parser.add_argument("--seconds", type=float, default=1.0, help="of all five parts together")
    parser.add_argument("--peer", action="append", default=[], help="a Python with jax and peers")
    parser.add_argument("--one", choices=PEERS, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(measure_peer(asked.one, int(asked.copies), asked.seconds)))
        return 0
    try:
        from gamekeeper.errors import DependencyError
        from gamekeeper.kernels.cuda import require_device

        require_device()
    except DependencyError as error:
        print(json.dumps({"subject": "gamekeeper", "missing": str(error)}))
        return 2
    for line in lines(asked):
        print(json.dumps(line), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
