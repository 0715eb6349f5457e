"""What a diagnosis and an attribution of 20 failing episodes of `warehouse` take.

Everything that the commands do by default: ideal substitutes, perturbations for every agent within
the budget, counterfactuals in both loops; shares, differences, Shapley values, influence, lazy
agents. Prints a JSON line for each command: wall seconds, processor seconds of all its processes,
episodes played.

    python benchmarks/diagnosis.py [--workers 2] [--seed 0] [--kwargs '{"observation_noise": ...}']
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

KWARGS = '{"observation_noise": {"carrier_0": 3.0, "carrier_1": 3.0}}'


def timed(*line: object) -> tuple[dict[str, Any], float, float]:
    """The document of a command, its wall and its processor seconds."""
    before, began = os.times(), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "gamekeeper", *map(str, line), "--json", "--quiet"],
        stdout=subprocess.PIPE,
        check=False,
    )
    after = os.times()
    if done.returncode not in (0, 1, 2) or not done.stdout:
        sys.exit(f"{line[0]} ended with {done.returncode}")
    cpu_s = sum(after[2:4]) - sum(before[2:4])
    return json.loads(done.stdout), time.perf_counter() - began, cpu_s


def main() -> None:
    """Records, diagnoses, attributes."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kwargs", default=KWARGS)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        lines = {
            "record": (
                "rollout",
                "warehouse",
                "--policy",
                "reference",
                "--kwargs",
                options.kwargs,
                "--episodes",
                20,
                "--seed",
                options.seed,
                "--out",
                run,
            ),
            "diagnose": ("diagnose", run, "--workers", options.workers),
            "attribute": ("attribute", run, "--workers", options.workers),
        }
        for name, line in lines.items():
            document, wall_s, cpu_s = timed(*line)
            told = {"measure": name, "wall_s": round(wall_s, 1), "cpu_s": round(cpu_s, 1)}
            if name == "diagnose":
                told |= {key: document[key] for key in ("recorded", "episodes")}
                told["answers"] = {
                    agent: [each["answer"], *each["labels"]]
                    for agent, each in document["agents"].items()
                }
            print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
