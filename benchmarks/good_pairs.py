"""How often the least set of differences between a good and a bad run is found exactly.

A pair is a good set-up and a bad one that differ in 5 to 12 things (arguments, reset options,
policies by agent, the wrapper), of which 1 or 2 matter. Pairs are drawn from the tables below; one
holds by this rule, stated beforehand and looked at by plain rollouts on seeds of their own:

- of 24 episodes the good set-up solves 22 or more, the bad one at most 8;
- with what matters put right alone, the bad one solves 22 or more: nothing else matters;
- of two that matter each alone closes less than half of the gap.

Pairs that don't come out so are drawn anew. Each is recorded for 10 episodes and diagnosed with
`good=`; no knob is declared. Prints a JSON line for each, then the share of exact sets with its
Wilson interval, and of healthy pairs (all differences harmless) those in which a cause is named.

    python benchmarks/good_pairs.py [--pairs 20] [--healthy 8] [--episodes 2000] [--seed 0]
"""

import argparse
import json
import random
import sys
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import gamekeeper as gk
from gamekeeper.episodes.outcome import failed, failures, outcome_of
from gamekeeper.statistics.significance import wilson

EPISODES = 24
SEED = 777_000
CODE = Path(__file__).with_name("good_pair_envs.py")
POLICIES = ("careful", "Again")
BAD = ("dazed", "idle", "turned")


@dataclass(frozen=True)
class Stack:
    """An environment, and the values of each of its settings: (good, bad), harmless or not."""

    factory: str
    agents: tuple[str, ...]
    harmless: Mapping[str, tuple[Any, Any]]
    causes: Mapping[str, tuple[Any, Any]]


STACKS = {
    "docks": Stack(
        "Docks",
        ("tug_0", "tug_1"),
        {
            "limit": (60, 66),
            "swell": (0.0, 0.05),
            "pay": (1.0, 10.0),
            "fee": (0.0, 0.01),
            "color": ("red", "blue"),
            "buoys": (2, 5),
            "depth": (10.0, 12.0),
            "lamps": (False, True),
            "length": (9, 10),
            "options.day": ("monday", "sunday"),
        },
        {"limit": (60, 3), "current": (0.0, 0.6), "fog": (0.0, 1.0), "options.tide": (0, 3)},
    ),
    "pantry": Stack(
        "Pantry",
        ("cook", "waiter"),
        {
            "patience": (60, 64),
            "draft": (0.0, 0.05),
            "tip": (1.0, 2.0),
            "fine": (0.0, 0.01),
            "music": ("jazz", "none"),
            "napkins": (2, 3),
            "candles": (False, True),
            "warmth": (20.0, 25.0),
            "tables": (7, 8),
            "options.guest": ("one", "two"),
        },
        {"patience": (60, 3), "spill": (0.0, 1.0), "options.rush": (False, True)},
    ),
    "spread": Stack(
        "spread",
        ("agent_0", "agent_1"),
        {
            "max_cycles": (45, 50),
            "jitter": (0.0, 0.002),
            "sticky": (0.0, 0.05),
            "gain": (1.0, 1.02),
            "local_ratio": (0.5, 0.8),
            "render_mode": (None, "rgb_array"),
            "factory": ("spread", "spread_rounded"),
            "options.day": ("monday", "sunday"),
        },
        {"max_cycles": (45, 6), "jitter": (0.0, 3.0), "sticky": (0.0, 0.97), "gain": (1.0, -1.0)},
    ),
    "speaker": Stack(
        "speaker",
        ("speaker_0", "listener_0"),
        {
            "max_cycles": (45, 50),
            "jitter": (0.0, 0.002),
            "sticky": (0.0, 0.02),
            "gain": (1.0, 1.02),
            "render_mode": (None, "rgb_array"),
            "options.day": ("monday", "sunday"),
            "options.room": (1, 2),
        },
        {"max_cycles": (45, 6), "jitter": (0.0, 3.0), "gain": (1.0, -1.0)},
    ),
}


Settings = dict[str, Any]


@dataclass(frozen=True)
class Pair:
    """Settings of both runs, by name of the difference, and those that matter."""

    stack: str
    good: Settings
    bad: Settings
    causes: tuple[str, ...]


def drawn(stack: str, causes: int, rng: random.Random) -> Pair:
    """A pair with so many differences that should matter; none: a healthy one."""
    table = STACKS[stack]
    harmless = dict(table.harmless)
    harmful = dict(table.causes)
    for agent in table.agents:
        harmless[f"policy.{agent}"] = ("good", rng.choice(POLICIES))
        harmful[f"policy.{agent}"] = ("good", rng.choice(BAD))
    chosen = rng.sample(sorted(harmful), causes)
    rest = [name for name in sorted(harmless) if name not in chosen]
    size = min(rng.randint(5, 12), causes + len(rest))
    both = {name: harmful[name] for name in chosen}
    both |= {name: harmless[name] for name in rng.sample(rest, size - causes)}
    order = sorted(both)
    good = {name: both[name][0] for name in order}
    return Pair(stack, good, {name: both[name][1] for name in order}, tuple(sorted(chosen)))


def recorded(pair: Pair, settings: Settings, *, episodes: int, seed: int) -> Any:
    """Evidence of a set-up."""
    table = STACKS[pair.stack]
    kwargs = {k: v for k, v in settings.items() if "." not in k and k != "factory"}
    options = {k.partition(".")[2]: v for k, v in settings.items() if k.startswith("options.")}
    policies = {agent: settings.get(f"policy.{agent}", "good") for agent in table.agents}
    return gk.rollout(
        f"{CODE}:{settings.get('factory', table.factory)}",
        env_kwargs=kwargs,
        policies={agent: f"{CODE}:{name}" for agent, name in policies.items()},
        options=options or None,
        episodes=episodes,
        seed=seed,
    )


def solved(pair: Pair, settings: Settings) -> int:
    """Number of `EPISODES` that are solved."""
    evidence = recorded(pair, settings, episodes=EPISODES, seed=SEED)
    conditions = failures(evidence.contract, condition(pair))
    told = [failed(outcome_of(each), conditions, evidence.contract) for each in evidence.episodes]
    return sum(not each["team"] for each in told)


def condition(pair: Pair) -> str:
    """The condition under which an episode failed."""
    return "left > 0" if pair.stack in ("docks", "pantry") else "left > 0.25"


def right(pair: Pair, *names: str) -> Settings:
    """The bad set-up with some settings as in the good one."""
    return {**pair.bad, **{name: pair.good[name] for name in names}}


def holds(pair: Pair) -> bool:
    """Tells whether a pair is what it claims to be, by the rule above."""
    best, worst = solved(pair, pair.good), solved(pair, pair.bad)
    if best < EPISODES - 2:
        return False
    if not pair.causes:
        return worst >= EPISODES - 2
    if worst > EPISODES // 3 or solved(pair, right(pair, *pair.causes)) < EPISODES - 2:
        return False
    if len(pair.causes) == 1:
        return True
    alone = [solved(pair, right(pair, name)) for name in pair.causes]
    return all(each - worst < (best - worst) / 2 for each in alone)


def pairs(most: int, *, causes: Sequence[int], seed: int) -> Iterator[Pair]:
    """So many pairs that hold, from each environment in turn."""
    names = list(STACKS)
    for number in range(most):
        for attempt in count():
            rng = random.Random(f"{seed} {causes} {number} {attempt}")
            pair = drawn(
                names[number % len(names)], causes[number // len(names) % len(causes)], rng
            )
            if holds(pair):
                yield pair
                break


def diagnosed(pair: Pair, *, episodes: int, seed: int) -> dict[str, Any]:
    """The least sets of differences that the diagnosis names, in the words of the tables."""
    bad = recorded(pair, pair.bad, episodes=10, seed=seed + 1)
    good = recorded(pair, pair.good, episodes=10, seed=seed + 2)
    began = time.perf_counter()
    found = gk.diagnose(
        bad, good=good, failed=condition(pair), episodes=episodes, seed=seed, allow_import=True
    )
    assert found.differences is not None
    sets = [sorted(map(_word, each)) for each in found.differences.least]
    return {
        "sets": sets,
        "exact": sets == [list(pair.causes)],
        "answers": {name: each.answer for name, each in found.agents.items()},
        "why": found.differences.why,
        "episodes": found.episodes,
        "seconds": round(time.perf_counter() - began, 1),
    }


def _word(name: str) -> str:
    """A difference in the words of the tables: `policy[tug_0]` is `policy.tug_0`."""
    return {"environment": "factory"}.get(name, name.replace("[", ".").removesuffix("]"))


def main() -> None:
    """Diagnoses the pairs and says how often it was right."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--healthy", type=int, default=8)
    parser.add_argument("--episodes", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of mpe2's Box spaces
    exact = accused = 0
    wanted = [*pairs(options.pairs, causes=(1, 2), seed=options.seed)]
    for pair in [*wanted, *pairs(options.healthy, causes=(0,), seed=options.seed)]:
        row = diagnosed(pair, episodes=options.episodes, seed=options.seed)
        exact += row["exact"] and bool(pair.causes)
        accused += bool(row["sets"]) and not pair.causes
        head = {"stack": pair.stack, "differences": len(pair.good), "causes": pair.causes}
        print(json.dumps({**head, **row}), flush=True)
    share = wilson(exact, options.pairs)
    said = {"exact": exact, "of": options.pairs, "interval": [share.low, share.high]}
    healthy = {"healthy accused": accused, "healthy": options.healthy}
    print(json.dumps({"measure": "least sets of differences", **said, **healthy}))


if __name__ == "__main__":
    main()
