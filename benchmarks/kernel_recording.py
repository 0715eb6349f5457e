"""What recording a kernel batch costs beside the bare batch, an agent-step.

Random legal actions, whose choice isn't timed; both levels; the same run bare and recorded, one
after the other, medians of several rounds. Closing (finalizing, Parquet) is timed apart. With
`--serial` the serial engine's recording of the same copies beside it.

One JSON line a task, level and number of copies: {"figure", "task", "engine", "level", "copies",
"steps", "agent_steps", "bare_us", "recorded_us", "overhead_us", "overhead_cpu_us", "close_us",
"bytes"}; times an agent-step, `cpu` of the processor, which a busy machine disturbs less.

    python benchmarks/kernel_recording.py [--tasks two_robot_line ...] [--copies 64 1024]
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from vector_same import actions_of

import gamekeeper as gk

FIGURE: Final = "kernel_recording"
TASKS: Final = ("two_robot_line", "handover", "warehouse", "warehouse_turns")
AGENT_STEPS: Final = 400_000


def played(venv: Any, steps: int) -> tuple[float, float, int]:
    """Seconds of the steps alone, by the clock and of the processor, and agent-steps."""
    _, infos = venv.reset(seed=0)
    spent_s, busy_s, done, none = 0.0, 0.0, 0, np.zeros(venv.num_envs, np.int64)
    for step in range(steps):
        actions = actions_of(venv, infos, none + step)
        lives = infos["live"].values() if isinstance(infos["live"], dict) else [infos["live"]]
        done += venv.num_envs if venv.api == "aec" else sum(int(each.sum()) for each in lives)
        begun_s, idle_s = time.perf_counter(), time.process_time()
        infos = venv.step(actions)[-1]
        spent_s += time.perf_counter() - begun_s
        busy_s += time.process_time() - idle_s
    return spent_s, busy_s, done


def once(task: str, engine: str, copies: int, level: str, agent_steps: int) -> dict[str, float]:
    """One bare and one recorded run."""
    with gk.vector.make(task, copies, engine=engine, copy=False) as venv:
        agents = 1 if venv.api == "aec" else sum(len(group.agents) for group in venv.groups)
        steps = max(4, agent_steps // (copies * agents))
        played(venv, 2)
        bare_s, idle_s, done = played(venv, steps)
    with tempfile.TemporaryDirectory(prefix="kernel-recording-") as folder:
        out = Path(folder, "run")
        venv = gk.record(gk.vector.make(task, copies, engine=engine, copy=False), out, level=level)
        recorded_s, busy_s, also = played(venv, steps)
        begun_s = time.perf_counter()
        venv.close()
        close_s = time.perf_counter() - begun_s
        size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    assert done == also
    parts = {
        "bare": bare_s,
        "recorded": recorded_s,
        "overhead": recorded_s - bare_s,
        "overhead_cpu": busy_s - idle_s,
    }
    found = {f"{name}_us": seconds / done * 1e6 for name, seconds in parts.items()}
    return {
        **found,
        "close_us": close_s / done * 1e6,
        "bytes": size / done,
        "steps": steps,
        "agent_steps": done,
    }


def main() -> int:
    """Prints the medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--copies", nargs="+", type=int, default=[64, 1024])
    parser.add_argument("--levels", nargs="+", default=["full", "digest"])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--agent-steps", type=int, default=AGENT_STEPS)
    parser.add_argument("--serial", action="store_true", help="the serial engine beside it")
    given = parser.parse_args()
    engines = ("kernel", "serial") if given.serial else ("kernel",)
    for task in given.tasks:
        for copies in given.copies:
            for level in given.levels:
                for engine in engines:
                    work = given.agent_steps if engine == "kernel" else given.agent_steps // 20
                    once(task, engine, copies, level, 4 * copies)  # compiles
                    rounds = [once(task, engine, copies, level, work) for _ in range(given.rounds)]
                    medians = {
                        name: round(statistics.median(each[name] for each in rounds), 3)
                        for name in rounds[0]
                    }
                    print(
                        json.dumps(
                            {
                                "figure": FIGURE,
                                "task": task,
                                "engine": engine,
                                "level": level,
                                "copies": copies,
                                **medians,
                            }
                        ),
                        flush=True,
                    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
