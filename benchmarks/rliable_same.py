"""Whether aggregates over environments and the probability of improvement are rliable's.

    python benchmarks/rliable_same.py --peer rliable=PATH/bin/python

rliable lives in an environment of its own, which benchmarks/peers/rliable.in names
(`requirements/setup.sh make DIR && requirements/setup.sh install DIR benchmarks/peers/rliable.in`,
on Python 3.11). Prints a JSON line for each figure: the largest difference over 100 pairs of random
score matrices, some of them with ties, with 1 to 30 runs in 1 to 12 environments.
"""

import argparse
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from gamekeeper.statistics.aggregates import AGGREGATES, aggregate, probability_of_improvement

Matrix = list[list[float]]


def pairs(many: int, seed: int) -> list[tuple[Matrix, Matrix]]:
    """Score matrices [runs, environments] of two methods, every third with few distinct values."""
    rng = np.random.default_rng(seed)
    made = []
    for number in range(many):
        environments = int(rng.integers(1, 13))
        both = []
        for _ in range(2):
            scores = rng.normal(0.6, 0.5, (int(rng.integers(1, 31)), environments))
            both.append((scores.round(1) if number % 3 == 0 else scores).tolist())
        made.append((both[0], both[1]))
    return made


def ours(one: Matrix, two: Matrix) -> dict[str, float]:
    """The same figures by gamekeeper."""
    a, b = np.array(one).T, np.array(two).T
    by_environment: dict[str, Any] = {str(k): column for k, column in enumerate(a)}
    found = {name: aggregate(by_environment, statistic=name) for name in AGGREGATES}
    beaten = [probability_of_improvement(*columns) for columns in zip(a, b, strict=True)]
    return found | {"improvement": float(np.mean(beaten))}


def main() -> None:
    """Prints the lines."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", required=True, metavar="rliable=PYTHON")
    parser.add_argument("--matrices", type=int, default=100)
    options = parser.parse_args()
    python = options.peer.removeprefix("rliable=")
    asked = pairs(options.matrices, seed=0)
    script = Path(__file__).parent / "peers" / "rliable_aggregates.py"
    answer = subprocess.run(
        [python, str(script)], input=json.dumps(asked), capture_output=True, text=True, check=True
    )
    theirs, mine = json.loads(answer.stdout), [ours(*pair) for pair in asked]
    for name in mine[0]:
        off = max(abs(a[name] - b[name]) for a, b in zip(mine, theirs, strict=True))
        print(json.dumps({"figure": name, "matrices": len(asked), "largest_difference": off}))


if __name__ == "__main__":
    main()
