"""What a tick of `pursuit` costs each agent, from a dozen agents to thousands.

    python benchmarks/pursuit.py [--quick]

Prints one JSON line for each figure: microseconds an agent-step, in processor time, by number
of agents, half pursuers and half evaders on a field with eight cells for each: of a compiled batch
with windows written (as many copies as make 4,096 agents), and of one copy through its PettingZoo
face; medians of segments. `exponent` is that of the power law fitted to them (0: the cost doesn't
grow with the agents, 1: it grows as they do). Agents die as they go, and only who lives counts. The
face is measured with Python's garbage collector off, too: it looks through all that lives, and of
thousands of agents that is much.
"""

import argparse
import gc
import json
import math
from collections.abc import Callable, Iterator
from statistics import median
from time import process_time

import numpy as np

from gamekeeper.kernels.batch import Batch
from gamekeeper.tasks.pursuit.pursuit import Pursuit, pursuit_kernel

SIZES = {"batch": (16, 128, 1024, 4096), "face": (16, 128, 1024)}
QUICK = {"batch": (16, 1024), "face": (16, 1024)}
FIGURES = {"batch": "batch", "face": "face", "face, collector off": "face"}
TOGETHER = 4096
SEGMENTS = 9
SEGMENT_S = 0.2


def arguments_of(agents: int) -> dict[str, int]:
    """A field with eight cells for each agent."""
    side = math.isqrt(8 * agents)
    return {"pursuers": agents // 2, "evaders": agents // 2, "rows": side, "columns": side}


def batch_steps(agents: int) -> Iterator[int]:
    """Steps many copies with random moves; yields how many agents were live."""
    batch = Batch(pursuit_kernel(**arguments_of(agents)), TOGETHER // agents, seed=0)
    batch.reset()
    rng = np.random.default_rng(0)
    moves = [rng.integers(0, 5, (TOGETHER // agents, agents // 2)) for _ in range(64)]
    for step in range(1 << 60):
        live = int(batch.arrays.live.sum())
        for group, actions in enumerate(batch.arrays.actions):
            actions[:] = moves[(2 * step + group) % 64]
        batch.step()
        yield live


def face_steps(agents: int) -> Iterator[int]:
    """Steps one copy with random moves; yields how many agents were live."""
    env, rng = Pursuit(**arguments_of(agents)), np.random.default_rng(0)
    env.reset(seed=0)
    moves = rng.integers(0, 5, (64, agents)).tolist()
    for step in range(1 << 60):
        if not env.agents:
            env.reset()
        live = len(env.agents)
        env.step(dict(zip(env.agents, moves[step % 64], strict=False)))
        yield live


def cost_us(steps: Callable[[int], Iterator[int]], agents: int) -> float:
    """Microseconds an agent-step: the median of segments."""
    playing = steps(agents)
    next(playing)  # compiles
    found = []
    for _ in range(SEGMENTS):
        began, count = process_time(), 0
        while process_time() - began < SEGMENT_S:
            count += next(playing)
        found.append((process_time() - began) / count * 1e6)
    return median(found)


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two sizes of each")
    sizes = QUICK if parser.parse_args().quick else SIZES
    for name, kind in FIGURES.items():
        if name != kind:
            gc.disable()
        steps = {"batch": batch_steps, "face": face_steps}[kind]
        cost = {agents: cost_us(steps, agents) for agents in sizes[kind]}
        logs = np.log(list(cost)), np.log(list(cost.values()))
        print(
            json.dumps(
                {
                    "figure": f"pursuit {name}, us an agent-step",
                    **{str(agents): round(us, 4) for agents, us in cost.items()},
                    "exponent": round(float(np.polyfit(*logs, 1)[0]), 3),
                }
            ),
            flush=True,
        )


if __name__ == "__main__":
    main()
