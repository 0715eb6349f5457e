"""Three teams in a warehouse, compared on the same days: which claims hold, and which don't.

    python examples/evaluate_warehouse.py [EPISODES]

plays evaluate_warehouse.toml, which stands beside it, and prints what may be said. Next to it is
how the policy in it is written: a plain function, named in the file by its place.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

import gamekeeper as gk
from gamekeeper.tasks.warehouse.warehouse import reference

SPEC = Path(__file__).with_suffix(".toml")
GUESSED = 0.3
"""The part of its moves that the hasty policy guesses."""


def hasty(observation: Any, agent: str, info: dict[str, Any], rng: np.random.Generator) -> int:
    """As the reference plays, but some moves are guessed among those that are legal."""
    if rng.random() < GUESSED:
        return int(rng.choice(np.flatnonzero(info["action_mask"])))
    return int(reference(observation, agent, info, rng))


def main(episodes: int | None = None) -> None:
    """Prints returns, what is claimed, and what isn't."""
    found = gk.evaluate(SPEC, episodes=episodes)
    for row in found.results:
        if (row["scope"], row["metric"]) == ("team", "return"):
            print(f"{row['environment']:6} {row['policy']:10} {row['mean']['value']:8.2f}")
    print(*found.claims, sep="\n")
    print("Not said:", *(f"{row['what']}: {row['why']}" for row in found.refused), sep="\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else None)
