"""How often a diagnosis is right of learnt policies: with nothing declared, beside a good one.

The set-ups come from learnt_policies.py: policies that SB3's PPO learnt (learnt_training.py), with
one fault as people report them, or none. Each that is what it claims to be is recorded for 10
episodes and diagnosed without a contract, a reference or a knob; with `--beside` the sound policy
is tried in each agent's place (`replace`). Prints a JSON line for each (also into `--keep`, from
which a second call goes on), then the shares with Wilson intervals; they are those of undo.py, and
*named, of restored*: of faults that a peer of the role or an undo from outside can restore, those
for which a cause is named.

    .venv-sb3/bin/python benchmarks/learnt_training.py --out learnt
    python benchmarks/learnt.py --folder learnt [--episodes 1000] [--seed 0] [--beside]
        [--seconds 170] [--keep learnt.jsonl]
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from learnt_policies import LearntCause, causes, holds
from undo import CAUSES, ORDER, read, shares
from undo_causes import Faulty

import gamekeeper as gk


def diagnosed(cause: LearntCause, *, episodes: int, seed: int, is_beside: bool) -> dict[str, Any]:
    """What the diagnosis says of a set-up."""
    evidence = gk.rollout(cause.env, policies=cause.policies, episodes=10, seed=seed + 1)
    began = time.process_time()
    found = gk.diagnose(
        evidence,
        env=cause.env,
        policies=cause.policies,
        replace={"*": Faulty(cause.sound)} if is_beside else None,
        failed=cause.failed,
        perturbations=False,
        episodes=episodes,
        seed=seed,
    )
    assert found.team is not None
    return {
        "answer": found.team.answer,
        "said": list(found.team.labels),
        "whom": sorted(name for name, each in found.agents.items() if each.component),
        "component": found.team.component or "",
        "why": found.team.why,
        "cpu_s": round(time.process_time() - began, 1),
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The shares, with Wilson intervals."""
    failing = [row for row in rows if row["agents"]]
    sound = [row for row in rows if not row["agents"]]
    restored = [row for row in failing if row["is_restored"]]
    named = [row for row in failing if row["answer"] in CAUSES]
    labelled = [row for row in named if row["said"] and row["answer"] != "ambiguous"]
    counts = {
        "named, of restored": (sum(row["answer"] in CAUSES for row in restored), len(restored)),
        "agent right": (sum(row["whom"] == row["agents"] for row in named), len(named)),
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
    parser.add_argument("--folder", type=Path, default=Path("learnt"))
    parser.add_argument("--episodes", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--beside", action="store_true", help="try the sound policy too")
    parser.add_argument("--seconds", type=float, default=1e9, help="after which no other begins")
    parser.add_argument("--keep", type=Path, default=Path("learnt.jsonl"))
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    began, known = time.perf_counter(), {row["name"] for row in read(options.keep)}
    cases = list(causes(options.folder))
    random.Random(ORDER).shuffle(cases)
    for cause in cases:
        if cause.name in known or time.perf_counter() - began > options.seconds:
            continue
        row: dict[str, Any] = {
            "name": cause.name,
            "agents": list(cause.agents),
            "labels": list(cause.labels),
            "is_restored": cause.is_restored,
        }
        if holds(cause):
            row |= diagnosed(
                cause, episodes=options.episodes, seed=options.seed, is_beside=options.beside
            )
            print(json.dumps(row), flush=True)
        with options.keep.open("a") as file:
            file.write(json.dumps(row) + "\n")
    rows = read(options.keep)
    held = [row for row in rows if "answer" in row]
    said = {"set-ups": len(rows), "of": len(cases), "held": len(held), **summary(held)}
    print(json.dumps({"measure": "learnt policies", "beside": options.beside, **said}))


if __name__ == "__main__":
    main()
