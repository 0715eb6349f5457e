"""How often a diagnosis with nothing declared is right: faults in policies, undone from outside.

The set-ups come from undo_causes.py, which knows nothing of the diagnosis: environments without
knobs, and policies with one fault inside, or none. Each that is what it claims to be is recorded
for 10 episodes and diagnosed without a contract, a reference or a knob. Prints a JSON line for each
(also into `--keep`, from which a second call goes on), then the shares with Wilson intervals:

- *named*: of undoable faults, those for which a cause is named;
- *agent right*: of failing set-ups with a cause, those in which the faulty agent alone is named;
- *agent right, isolated*: the same of answers that say which one it is (isolated, joint);
- *agent among them*: the same, where it may be one of several agents;
- *label right*: of answers with one label (isolated, joint), those that have the planted one;
- *healthy accused*: of healthy set-ups, those in which a cause is named.

The set-ups come in an order that is drawn once, so that a run of fewer is a sample of them.

    python benchmarks/undo.py [--episodes 1000] [--seed 0] [--most 200] [--keep undo.jsonl]
        [--also other.jsonl] [--kinds undoable inside healthy]
        [--envs berth spread "spread, Box" "speaker, AEC" hoist safe ants]
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from undo_causes import STACKS, Planted, healthy, holds, inside, undoable

import gamekeeper as gk
from gamekeeper.statistics.significance import wilson

ORDER = 7
CAUSES = ("isolated", "joint", "ambiguous", "protocol", "environment")


def diagnosed(planted: Planted, *, episodes: int, seed: int) -> dict[str, Any]:
    """What the diagnosis says of a set-up."""
    evidence = gk.rollout(planted.spec, policies=planted.policies, episodes=10, seed=seed + 1)
    began = time.perf_counter()
    found = gk.diagnose(
        evidence,
        env=planted.spec,
        policies=planted.policies,
        failed=planted.failed,
        perturbations=False,
        episodes=episodes,
        seed=seed,
    )
    assert found.team is not None
    return {
        "answer": found.team.answer,
        "said": list(found.team.labels),
        "whom": sorted(name for name, each in found.agents.items() if each.component),
        "why": found.team.why,
        "lags": {name: each.lag for name, each in found.responses.items()},
        "episodes": found.episodes,
        "seconds": round(time.perf_counter() - began, 1),
    }


def read(path: Path) -> list[dict[str, Any]]:
    """Rows of a file; none where there is no file yet."""
    lines = path.read_text().splitlines() if path.exists() else []
    return [json.loads(line) for line in lines]


def play(cases: Sequence[Planted], keep: Path, *, episodes: int, seed: int) -> None:
    """Looks at each set-up, and has those that hold diagnosed."""
    known = {row["name"] for row in read(keep)}
    for planted in cases:
        if planted.name in known:
            continue
        row: dict[str, Any] = {
            "name": planted.name,
            "kind": planted.kind,
            "agents": list(planted.agents),
            "labels": list(planted.labels),
        }
        if holds(planted):
            row |= diagnosed(planted, episodes=episodes, seed=seed)
            print(json.dumps(row), flush=True)
        with keep.open("a") as file:
            file.write(json.dumps(row) + "\n")


def shares(counts: Mapping[str, tuple[int, int]]) -> dict[str, Any]:
    """Hits of so many, by name, with Wilson intervals."""
    found: dict[str, Any] = {}
    for name, (hits, of) in counts.items():
        share = wilson(hits, of) if of else None
        interval = None if share is None else [round(share.low, 3), round(share.high, 3)]
        found[name] = {"hits": hits, "of": of, "interval": interval}
    return found


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The shares, with Wilson intervals."""
    undone = [row for row in rows if row["kind"] == "undoable"]
    lost = [row for row in rows if row["kind"] == "inside"]
    sound = [row for row in rows if row["kind"] == "healthy"]
    named = [row for row in [*undone, *lost] if row["answer"] in CAUSES]
    labelled = [row for row in named if row["said"] and row["answer"] != "ambiguous"]
    sure = [row for row in named if row["answer"] != "ambiguous"]
    counts = {
        "named, of undoable": (sum(row["answer"] in CAUSES for row in undone), len(undone)),
        "named, of those inside": (sum(row["answer"] in CAUSES for row in lost), len(lost)),
        "agent right": (sum(row["whom"] == row["agents"] for row in named), len(named)),
        "agent right, isolated": (sum(row["whom"] == row["agents"] for row in sure), len(sure)),
        "agent among them": (
            sum(set(row["agents"]) <= set(row["whom"]) for row in named),
            len(named),
        ),
        "label right": (sum(row["said"] == row["labels"] for row in labelled), len(labelled)),
        "healthy accused": (sum(row["answer"] in CAUSES for row in sound), len(sound)),
    }
    return shares(counts)


def main() -> None:
    """Plays what is wanted and says how often it was right."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--most", type=int, default=200, help="set-ups that are looked at")
    parser.add_argument("--kinds", nargs="+", default=["undoable", "inside", "healthy"])
    parser.add_argument("--envs", nargs="+", choices=STACKS, default=list(STACKS))
    parser.add_argument("--keep", type=Path, default=Path("undo.jsonl"))
    parser.add_argument("--also", type=Path, nargs="*", default=[], help="other parts' files")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of mpe2's Box spaces
    every = chain(undoable(), inside(), healthy())
    cases = [each for each in every if each.name.partition(":")[0] in options.envs]
    cases = [each for each in cases if each.kind in options.kinds]
    random.Random(ORDER).shuffle(cases)
    play(cases[: options.most], options.keep, episodes=options.episodes, seed=options.seed)
    rows = [row for path in (options.keep, *options.also) for row in read(path)]
    held = [row for row in rows if "answer" in row]
    said = {"set-ups": len(rows), "held": len(held), **summary(held)}
    print(json.dumps({"measure": "undone from outside", "episodes": options.episodes, **said}))


if __name__ == "__main__":
    main()
