"""How often a diagnosis with nothing declared is right on set-ups written for it to be tried on.

The set-ups come from fresh_causes.py and fresh_envs.py (AEC with Discrete, Parallel with Dict
observations), and were kept before any was diagnosed. Each that is what it claims to be is recorded
for 10 episodes and diagnosed without a contract, a reference or a knob. Prints a JSON line for each
(also into `--keep`, from which a second call goes on), then the shares with Wilson intervals:

- *named*: of failing set-ups, those for which a cause is named;
- *right*: of those, the faulty agent alone is named, or for a cut-off *protocol* and no agent;
- *right, sure*: the same of answers that aren't *ambiguous*;
- *among them*: the faulty agent is one of those named;
- *label right*: of answers with one label (isolated, joint, protocol), those with a planted one;
- *healthy accused*: of healthy set-ups, those in which a cause is named.

    python benchmarks/fresh.py [--episodes 1000] [--seed 0] [--part 0/1] [--keep fresh.jsonl]
        [--also other.jsonl] [--only TEXT]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from fresh_causes import FAILED, FreshCause, causes, holds
from undo import CAUSES, read, shares

import gamekeeper as gk


def diagnosed(cause: FreshCause, *, episodes: int, seed: int) -> dict[str, Any]:
    """What the diagnosis says of a set-up."""
    evidence = gk.rollout(
        cause.env, policies=cause.policies, episodes=10, seed=seed + 1, env_kwargs=cause.kwargs
    )
    began = time.process_time()
    found = gk.diagnose(
        evidence,
        env=cause.env,
        policies=cause.policies,
        failed=FAILED,
        perturbations=False,
        episodes=episodes,
        seed=seed,
    )
    assert found.team is not None
    named = [n for n, e in found.agents.items() if e.answer in CAUSES and e.component]
    return {
        "answer": found.team.answer,
        "said": list(found.team.labels),
        "whom": sorted(named) if found.team.answer not in ("environment", "protocol") else [],
        "component": found.team.component or "",
        "why": found.team.why,
        "cpu_s": round(time.process_time() - began, 1),
    }


def is_right(row: dict[str, Any]) -> bool:
    """Names the faulty agent alone, or a cut-off that is no agent's."""
    if row["kind"] == "protocol":
        return bool(row["answer"] == "protocol")
    return bool(row["whom"] == row["agents"])


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The shares, with Wilson intervals."""
    failing = [row for row in rows if row["kind"] != "healthy"]
    sound = [row for row in rows if row["kind"] == "healthy"]
    named = [row for row in failing if row["answer"] in CAUSES]
    sure = [row for row in named if row["answer"] != "ambiguous"]
    labelled = [row for row in sure if row["said"]]
    among = sum(is_right(row) or bool({*row["agents"]} & {*row["whom"]}) for row in named)
    right = sum({*row["said"]} <= {*row["labels"]} for row in labelled)
    return shares(
        {
            "named": (len(named), len(failing)),
            "right": (sum(map(is_right, named)), len(named)),
            "right, sure": (sum(map(is_right, sure)), len(sure)),
            "among them": (among, len(named)),
            "label right": (right, len(labelled)),
            "healthy accused": (sum(row["answer"] in CAUSES for row in sound), len(sound)),
        }
    )


def main() -> None:
    """Plays what is wanted and says how often it was right."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--part", default="0/1")
    parser.add_argument("--only", default="", help="set-ups with this in their name")
    parser.add_argument("--keep", type=Path, default=Path("fresh.jsonl"))
    parser.add_argument("--also", type=Path, nargs="*", default=[], help="other parts' files")
    options = parser.parse_args()
    place, parts = map(int, options.part.split("/"))
    known = {row["name"] for row in read(options.keep)}
    cases = [each for each in causes() if options.only in each.name]
    for cause in cases[place::parts]:
        if cause.name in known:
            continue
        row = {key: getattr(cause, key) for key in ("name", "kind", "agents", "labels")}
        row = json.loads(json.dumps(row))
        if holds(cause):
            row |= diagnosed(cause, episodes=options.episodes, seed=options.seed)
            print(json.dumps(row), flush=True)
        with options.keep.open("a") as file:
            file.write(json.dumps(row) + "\n")
    rows = [row for path in (options.keep, *options.also) for row in read(path)]
    held = [row for row in rows if "answer" in row]
    said = {"set-ups": len(rows), "held": len(held), **summary(held)}
    print(json.dumps({"measure": "fresh", "episodes": options.episodes, **said}))


if __name__ == "__main__":
    main()
