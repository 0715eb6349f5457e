"""Whether attribution finds lazy agents and penalties on the wrong participant, and what it takes.

    python benchmarks/attribution.py [--lazy N] [--fair N] [--wrong N] [--part K/M] [--time]

Prints a JSON line for each case and one for each kind. The cases are warehouses with three
pickers, of sizes drawn by the case's number: `lazy` ones, in which one picker stays where it is;
`fair` ones, in which all play the reference policy; `wrong` ones, in which a robot that stands
still pays for one that runs into it. A wrong one is right if whoever stood still in half of the
collisions it paid for is named, and nobody whom standing still would always have spared them.
`--part 0/2` does every second case, so that two processes share the work. `--time` says how long 20
recorded episodes of the usual warehouse take on two cores.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from pettingzoo.utils import BaseParallelWrapper

import gamekeeper as gk
from gamekeeper.diagnosis.attribution.contributions import attribute

STILL = 4
STEPS = {0: (-1, 0), 1: (0, 1), 2: (1, 0), 3: (0, -1)}
EPISODES = 2  # recorded
PAPERS = 2  # of `fair` and `lazy` ones
BUMPS = 8  # recorded and looked into, of `wrong` ones


class Blaming(BaseParallelWrapper):  # type: ignore[misc]  # PettingZoo's is untyped
    """A warehouse in which a robot that stands still pays for one that runs into it."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(gk.make("warehouse", **kwargs))
        self.terms: dict[Any, dict[str, float]] = {}

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody has been paid."""
        self.terms = {}
        return self.env.reset(seed=seed, options=options)

    def step(self, actions: Any) -> Any:
        """Moves what a collision costs to the robot that stands in the way."""
        seen, rewards, terms, truncs, infos = self.env.step(actions)
        self.terms = {a: dict(paid) for a, paid in self.env.unwrapped.terms.items()}
        rewards = dict(rewards)
        places = {tuple(map(int, infos[a]["position"])): a for a in infos}
        for agent, action in actions.items():
            cost = self.terms.get(agent, {}).get("collision", 0.0)
            if cost >= 0 or int(action) not in STEPS or agent not in infos:
                continue
            row, column = (int(x) for x in infos[agent]["position"])
            there = places.get((row + STEPS[int(action)][0], column + STEPS[int(action)][1]))
            if there in rewards and int(actions.get(there, 0)) == STILL:
                self.terms[agent]["collision"] = 0.0
                paid = self.terms.setdefault(there, {})
                paid["collision"] = paid.get("collision", 0.0) + cost
                rewards[agent] -= cost
                rewards[there] += cost
        return seen, rewards, terms, truncs, infos


def case(kind: str, number: int) -> dict[str, Any]:
    """One case, as it came out."""
    rng = np.random.default_rng([number, len(kind)])
    kwargs = {
        "pickers": 3,
        "carriers": int(rng.integers(1, 3)),
        "spares": 0,
        "orders": int(rng.integers(3, 8)),
        "every": int(rng.integers(2, 7)),
        "horizon": int(rng.integers(35, 71)),
        "battery": 80,
    }
    planted = f"picker_{int(rng.integers(3))}" if kind == "lazy" else None
    policies = {"*": "greedy" if kind == "wrong" else "reference"}
    if kind == "wrong":
        policies["picker_0"] = "lazy"  # somebody to run into
    if planted:
        policies[planted] = "lazy"
    spec: Any = Blaming if kind == "wrong" else "warehouse"
    contract = gk.rollout("warehouse", episodes=1).contract
    evidence = gk.rollout(
        spec,
        policies=policies,
        seed=number,
        env_kwargs=kwargs,
        contract=contract,
        episodes=BUMPS if kind == "wrong" else EPISODES,
    )
    start = time.perf_counter()
    found = attribute(
        evidence,
        env=spec,
        policies=policies,
        seed=number,
        action_episodes=BUMPS if kind == "wrong" else PAPERS,
        episodes=0 if kind == "wrong" else None,
    )
    wrong = [[each.agent, each.term, dict(each.by)] for each in found.wrong_penalties]
    looked = sum(each.wrong.n for each in found.penalties if each.term == "collision")
    told: Any = wronged(evidence.episodes) if kind == "wrong" else planted
    return {
        "kind": kind,
        "case": number,
        **kwargs,
        "planted": told,
        "lazy": list(found.lazy),
        "wrong": wrong,
        "collisions": looked,
        "seconds": round(time.perf_counter() - start, 1),
        "why": {a: part.laziness.why for a, part in found.agents.items()} if planted else None,
    }


def wronged(episodes: Iterable[Any]) -> dict[str, list[float]]:
    """Of the collisions that each agent paid for: in which part it stood still, by the rules.

    And in which part standing still would have spared it nothing, as another wanted its cell.
    """
    found: dict[str, list[tuple[bool, bool]]] = {}
    for episode in episodes:
        for turn in episode.turns:
            at = {a: tuple(map(int, info["position"])) for a, info in turn.infos.items()}
            to = {
                a: (at[a][0] + STEPS[int(x)][0], at[a][1] + STEPS[int(x)][1])
                for a, x in turn.actions.items()
                if int(x) in STEPS
            }
            for agent, paid in turn.terms.items():
                if paid.get("collision", 0.0) < 0 and agent in turn.actions:
                    stood = int(turn.actions[agent]) == STILL
                    is_pressed = any(cell == at[agent] for cell in to.values())
                    found.setdefault(agent, []).append((stood, is_pressed))
    return {
        agent: [round(sum(part) / len(each), 3) for part in zip(*each, strict=True)]
        for agent, each in sorted(found.items())
    }


def is_right(row: dict[str, Any]) -> bool:
    """Whether what was planted was found, and nothing else."""
    if row["kind"] == "wrong":
        named = {agent for agent, term, _ in row["wrong"] if term == "collision"}
        sure = {agent for agent, (stood, _) in row["planted"].items() if stood >= 0.5}
        return sure <= named <= {agent for agent, parts in row["planted"].items() if any(parts)}
    return row["lazy"] == ([row["planted"]] if row["planted"] else []) and not row["wrong"]


def seconds() -> dict[str, Any]:
    """How long 20 recorded episodes of the usual warehouse take."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        gk.rollout("warehouse", policies="reference", episodes=20, out=run)
        start = time.perf_counter()
        found = attribute(run, workers=2)
        taken = time.perf_counter() - start
    return {"kind": "time", "workers": 2, "seconds": round(taken, 1), "fresh": found.fresh}


def main() -> None:
    """Prints cases and counts."""
    parser = argparse.ArgumentParser()
    for kind, usual in (("lazy", 20), ("fair", 200), ("wrong", 20)):
        parser.add_argument(f"--{kind}", type=int, default=usual, metavar="N")
    parser.add_argument("--part", default="0/1", metavar="K/M")
    parser.add_argument("--time", action="store_true")
    options = parser.parse_args()
    if options.time:
        print(json.dumps(seconds()), flush=True)
        return
    place, parts = map(int, options.part.split("/"))
    for kind in ("lazy", "wrong", "fair"):
        rows = []
        for number in range(place, getattr(options, kind), parts):
            rows.append(case(kind, number))
            print(json.dumps(rows[-1] | {"right": is_right(rows[-1])}), flush=True)
        right = sum(map(is_right, rows))
        print(json.dumps({"kind": kind, "cases": len(rows), "right": right}), flush=True)


if __name__ == "__main__":
    main()
