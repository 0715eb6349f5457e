"""What level `actions` adds in the step's own thread: processor time, without a writer.

Prints a JSON line for each task: medians over interleaved segments, in microseconds of processor
time per agent-step; the buffer is emptied, not encoded, so encoding and closing aren't in it.

    python benchmarks/recording_step.py [--tasks two_robot_line,aec_ours_2] [--segments 5]
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from recording import tasks

from gamekeeper.episodes.buffer import TURN, Buffer
from gamekeeper.episodes.layout import Layout
from gamekeeper.interface.packing import Rings
from gamekeeper.interface.recorded_env import capture_of, recorded_of

WAITING = 20_000  # turns on the buffer before it is emptied
TURNS = 20_000  # of a segment, at most


class EmptiedSink:
    """Takes what a capture puts on the buffer, and drops it."""

    level = "actions"

    def __init__(self) -> None:
        self.buffer, self.layout, self.rings = Buffer(), Layout(()), Rings()

    def keep_up(self) -> None:
        """Empties a long buffer."""
        buffer, usual = self.buffer, self.buffer.usual
        if len(buffer.turns) >= WAITING * TURN:
            for items in (buffer.given, buffer.done, buffer.turns, buffer.starts, buffer.ends):
                items.clear()
            for items in (usual.agents, usual.actions, usual.rewards):
                items.clear()

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Takes no frames."""


def measure(make: Callable[[], Any], player: Callable[..., int], turns: int, kind: str) -> float:
    """Microseconds of processor time of this thread per agent-step."""
    env = make()
    if kind != "bare":
        env = recorded_of(capture_of(env, sink=EmptiedSink()))
    rng = np.random.default_rng(0)
    start = time.thread_time()
    count = player(env, turns, rng)
    return (time.thread_time() - start) * 1e6 / count


def main() -> None:
    """Measures the tasks asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", default="two_robot_line,aec_ours_2,aec_ours_512")
    parser.add_argument("--segments", type=int, default=5)
    options = parser.parse_args()
    for name, make, player, turns in tasks():
        if name not in options.tasks.split(","):
            continue
        times: dict[str, list[float]] = {"bare": [], "actions": []}
        for _ in range(options.segments):
            for kind, values in times.items():
                values.append(measure(make, player, min(turns, TURNS), kind))
        added = [a - b for a, b in zip(times["actions"], times["bare"], strict=True)]
        row = {
            "task": name,
            "bare_us": round(statistics.median(times["bare"]), 2),
            "added_us": round(statistics.median(added), 2),
            "added_us_low": round(min(added), 2),
            "added_us_high": round(max(added), 2),
        }
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
