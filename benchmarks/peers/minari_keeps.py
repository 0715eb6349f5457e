"""What Minari's collector keeps of a value that isn't as declared, and of a killed process.

    MINARI_PYTHON benchmarks/peers/minari_keeps.py        # its Python: benchmarks/peers/minari.in

Prints a JSON line for each: the declared dtype and the one that is loaded again; episodes that had
ended before a kill -9, and data sets that Minari lists afterwards.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete


class Drifts(gymnasium.Env[Any, Any]):
    """Declares one float32 in [0, 1]; unless it is sound, gives float64, and later 2.0."""

    observation_space = Box(0.0, 1.0, (1,), np.float32)
    action_space = Discrete(2)

    def __init__(self, *, is_sound: bool = False) -> None:
        self.dtype, self.later = (np.float32, 0.5) if is_sound else (np.float64, 2.0)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begins at a number that float32 can't hold."""
        super().reset(seed=seed)
        self.clock = 0
        return np.array([0.1 + 1e-9], self.dtype), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Leaves the space; ends after five steps."""
        self.clock += 1
        return np.array([self.later], self.dtype), 1.0, self.clock >= 5, False, {}


def collect(folder: str, episodes: int, form: str) -> Any:
    """A collector that has seen so many episodes."""
    os.environ["MINARI_DATASETS_PATH"] = folder
    import minari

    env = minari.DataCollector(Drifts(is_sound=episodes > 1), data_format=form)
    for seed in range(episodes):
        env.reset(seed=seed)
        ended = False
        while not ended:
            _, _, ended, _, _ = env.step(0)
        if episodes > 1_000:
            print(seed + 1, flush=True)
    return env


def nonconforming(form: str) -> dict[str, Any]:
    """What is loaded again of values that aren't as declared."""
    with tempfile.TemporaryDirectory() as folder:
        env = collect(folder, 1, form)
        data = env.create_dataset(dataset_id="drifts/x-v0")
        seen = next(iter(data.iterate_episodes())).observations
        return {
            "figure": "minari_nonconforming",
            "format": form,
            "given": ["float64", 0.1 + 1e-9, 2.0],
            "loaded": [str(seen.dtype), float(seen[0][0]), float(seen[1][0])],
        }


def killed(form: str) -> dict[str, Any]:
    """What is listed after a kill -9 in the middle of collecting."""
    with tempfile.TemporaryDirectory() as folder:
        child = subprocess.Popen(
            [sys.executable, __file__, "--collect", folder, form], stdout=subprocess.PIPE, text=True
        )
        assert child.stdout is not None
        ended = 0
        for line in child.stdout:
            ended = int(line)
            if ended == 200:
                child.send_signal(signal.SIGKILL)
        child.wait()
        os.environ["MINARI_DATASETS_PATH"] = folder
        import minari

        files = [p for p in Path(folder).rglob("*") if p.is_file()]
        return {
            "figure": "minari_killed",
            "format": form,
            "episodes_ended": ended,
            "datasets_listed": len(minari.list_local_datasets()),
            "bytes_left": sum(p.stat().st_size for p in files),
        }


def main() -> None:
    """Prints the lines."""
    warnings.simplefilter("ignore")
    if sys.argv[1:2] == ["--collect"]:
        collect(sys.argv[2], 1_000_000, sys.argv[3])
    for form in ("hdf5", "arrow"):
        for figure in (nonconforming, killed):
            try:
                line = figure(form)
            except Exception as error:
                line = {"figure": figure.__name__, "format": form, "raised": repr(error)[:300]}
            print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
