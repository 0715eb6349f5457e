"""Where the cost of recording goes: rows taken down in the step, journaled, encoded, appended.

Prints a JSON line for each task, in microseconds of processor time of one thread per agent-step,
the least of short interleaved bursts, so that it can be run beside other work: `bare` for the
environment, `taken` for what the capture adds in the step, `state` for what the environment's own
`state()` does once a turn (noise where it has none), `journaled` for copying 40 ms of turns into
the journal as they stand, `encoded` for making columns and digests of as many turns, `appended` for
handing them to the operating system. What two threads that share one interpreter cost each other,
and closing the run, are in `recording.py` only.

    python benchmarks/recording_parts.py [--tasks two_robot_line,aec_ours_2] [--bursts 60]
        [--level actions]
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from recording import tasks

from gamekeeper.episodes.buffer import Buffer, BufferedTurns, take
from gamekeeper.episodes.encoder import Encoder
from gamekeeper.episodes.evidence import manifest_of
from gamekeeper.episodes.layout import Layout
from gamekeeper.interface.packing import Rings
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from gamekeeper.runs.files.store import RunStore

TURNS: Final = {"two_robot_line": 400, "aec": 800, "spread": 40}  # of a burst
BUFFERED_PARTS: Final = {"two_robot_line": 2048, "aec": 4096, "spread": 133}  # turns in 40 ms
BUFFERED_COUNT: Final = 5


class Held:
    """A sink whose buffer is taken by whoever measures."""

    def __init__(self, level: str) -> None:
        self.buffer, self.layout, self.rings = Buffer(), Layout(), Rings()
        self.level = level

    def keep_up(self) -> None:
        """Nothing holds the step back."""

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """No frame is asked for."""


def stepping(
    make: Callable[[], Any], player: Callable[..., int], turns: int, bursts: int, level: str
) -> list[float]:
    """Seconds per agent-step: the bare environment, with rows taken down, with states too."""
    arms = []
    for state in (None, False, True):
        env, sink = make(), Held(level)
        arms.append(
            (env if state is None else recorded_of(capture_of(env, sink=sink, state=state)), sink)
        )
    least = [float("inf")] * len(arms)
    for _ in range(bursts):
        for place, (env, sink) in enumerate(arms):
            rng = np.random.default_rng(0)
            start = time.thread_time()
            count = player(env, turns, rng)
            least[place] = min(least[place], (time.thread_time() - start) / count)
            while take(sink.buffer, most=turns) is not None:
                pass
    for env, _ in arms:
        env.close()
    return least


def writing(
    make: Callable[[], Any], player: Callable[..., int], turns: int, bursts: int, level: str
) -> tuple[float, float, float]:
    """Seconds per row of journaling `turns` buffered turns, of encoding and of appending them."""
    sink = Held(level)
    env = recorded_of(capture_of(make(), sink=sink))
    rows = player(env, turns * BUFFERED_COUNT, np.random.default_rng(0))
    env.close()
    buffered_parts: list[BufferedTurns] = []
    while (buffered := take(sink.buffer, most=turns)) is not None:
        buffered_parts.append(buffered)
    journaled, encoded, appended = np.full((3, len(buffered_parts)), np.inf)
    for _ in range(max(3, bursts // 5)):
        encoder = Encoder(sink.layout, sink.rings.open, level=level)
        manifest = manifest_of(
            layout=sink.layout, environment={}, contract=None, level=level, run_seed=0
        )
        with tempfile.TemporaryDirectory() as folder:
            store = RunStore.create(Path(folder) / "run", manifest)
            for place, buffered in enumerate(buffered_parts):
                start = time.thread_time()
                assert store.journal.write(buffered, sink.layout, is_timed=False)
                written = time.thread_time()
                journaled[place] = min(journaled[place], written - start)
                store.journal.clear()
                start = time.thread_time()
                batches = list(encoder.encode_turns(buffered).in_order())
                middle = time.thread_time()
                for stream, batch in batches:
                    store.append(stream, batch)
                end = time.thread_time()
                encoded[place] = min(encoded[place], middle - start)
                appended[place] = min(appended[place], end - middle)
            store.abandon()
    return journaled.sum() / rows, encoded.sum() / rows, appended.sum() / rows


def main() -> None:
    """Measures the tasks asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", default="two_robot_line,aec_ours_2,aec_documented_512,spread")
    parser.add_argument("--bursts", type=int, default=60)
    parser.add_argument("--level", default="full")
    options = parser.parse_args()
    for name, make, player, _ in tasks():
        kind = next((kind for kind in TURNS if name.startswith(kind)), None)
        if name not in options.tasks.split(",") or kind is None:
            continue
        turns = 100 if name.endswith("_512") else TURNS[kind]
        buffered = 500 if name.endswith("_512") else BUFFERED_PARTS[kind]
        bare, taken, stated = stepping(make, player, turns, options.bursts, options.level)
        journaled, encoded, appended = writing(
            make, player, buffered, options.bursts, options.level
        )
        parts = {
            "bare": bare,
            "taken": taken - bare,
            "state": stated - taken,
            "journaled": journaled,
            "encoded": encoded,
            "appended": appended,
        }
        row = {f"{part}_us": round(seconds * 1e6, 2) for part, seconds in parts.items()}
        head = {"figure": "recording_parts", "task": name, "level": options.level}
        print(json.dumps({**head, **row}), flush=True)


if __name__ == "__main__":
    main()
