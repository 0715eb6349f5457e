"""Audits of small environments written as strangers write them: what is planted, what is told.

    python benchmarks/strangers/audit.py [--budget 3000] [--only WORD ...]

The environments and what is planted in them were committed before any audit of them. A planted
fault is given by the checks of which one must be told, as a cause; a cause of severity high or
medium that stands for no planted fault is extra, and of a sound environment all are. Prints a JSON
line for each environment, then the counts; exits 1 where a fault is missed or a cause is extra.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from gamekeeper.auditing.audit_process import audit

HERE: Final = "benchmarks.strangers"
FAULTY: Final[Mapping[str, Sequence[Collection[str]]]] = {
    "parallel_envs:Harbour": [
        {"GK608"},  # a set of names is walked through where boats want one berth
        {"GK636", "GK814"},  # state() adds noise by the game's own generator
    ],
    "parallel_envs:Canvas": [{"GK610", "GK614", "GK620"}],  # all are handed the game's own array
    "parallel_envs:Relay": [{"GK411"}],  # one of two terms comes a tick late
    "parallel_envs:Depot": [
        {"GK607"},  # the shelves are an array of the class
        {"GK214"},  # a cart takes two at a time, also where one has room
    ],
    "aec_envs:Auction": [
        {"GK604", "GK607"},  # a mutable default of reset's options keeps the money
        {"GK403", "GK407"},  # the last prize is entered once rewards were accumulated
    ],
    "aec_envs:Tiles": [
        {"GK602"},  # gusts are drawn from the global random
        {"GK235", "GK221"},  # the mask is made before the gust
    ],
    "aec_envs:courier": [
        {"GK601"},  # one step in ten slips, by the clock
        {"GK630"},  # a wrapper clips the caller's action in place
    ],
    "later_parallel_envs:Drones": [{"GK604"}],  # half-empty batteries stay as they are
    "later_parallel_envs:Quarry": [
        {"GK311"}
    ],  # the first action of the dictionary takes the last stone
    "later_parallel_envs:Kiln": [{"GK604"}],  # burns on over resets, and out of its Box
    "later_parallel_envs:Ferry": [{"GK817"}],  # state() is noted before the moves
    "later_aec_envs:Nim": [{"GK235"}],  # the mask is that of the player before
    "later_aec_envs:Ledger": [{"GK405"}],  # rewards are never cleared
    "later_aec_envs:Icewalk": [{"GK601"}],  # one step in ten slips, by a generator without a seed
    "later_aec_envs:Choir": [{"GK212"}],  # float64 from the fifteenth turn on
    "late_envs:Orchard": [{"GK411"}],  # full baskets are paid a tick late, to all
    "late_envs:Tollway": [{"GK411"}],  # the toll is charged a turn late
    "late_envs:Convoy": [{"GK411"}],  # gaps are those of before the moves, beside a cost on time
}
SOUND: Final = (
    "parallel_envs:Station",
    "parallel_envs:Tournament",
    "parallel_envs:Ripples",
    "parallel_envs:scaled_pasture",
    "aec_envs:Duel",
    "aec_envs:Frost",
    "later_parallel_envs:Market",
    "later_parallel_envs:Cameras",
    "later_parallel_envs:Shuffle",
    "later_aec_envs:Dice",
    "later_aec_envs:Parley",
    "late_envs:Invoices",
    "late_envs:Bakery",
)


def main() -> int:
    """Audits them all; 1 where a fault is missed or something else is told."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--budget", type=int, default=3_000, help="env steps (default: 3000)")
    parser.add_argument(
        "--only", nargs="*", default=[], help="words, one of which a name must hold"
    )
    asked = parser.parse_args()
    planted = {**FAULTY, **dict.fromkeys(SOUND, ())}
    names = [n for n in planted if not asked.only or any(word in n for word in asked.only)]
    rows = [audited(name, planted[name], asked.budget) for name in names]
    faults = sum(len(planted[name]) for name in names)
    missed, extra = (sum(len(row[key]) for row in rows) for key in ("missed", "extra"))
    print(f"{len(rows)} environments, {faults} planted: {missed} missed, {extra} extra causes")
    return int(missed + extra > 0)


def audited(name: str, planted: Sequence[Collection[str]], budget: int) -> dict[str, Any]:
    """Causes and consequences of one environment, beside what is planted in it."""
    result = audit(f"{HERE}.{name}", budget=budget, prints=os.devnull)
    causes = [each.id for each in result.failed if each.follows_from is None]
    weighty = [each.id for each in result.failed if each.severity != "low" and each.id in causes]
    hits = [[id for id in causes if id in ids] for ids in planted]
    row = {
        "environment": name,
        "causes": causes,
        "consequences": {
            each.id: each.follows_from.id for each in result.failed if each.follows_from
        },
        "suspected": [each.id for each in result.verdicts if each.outcome == "suspected"],
        "missed": [sorted(ids) for ids, hit in zip(planted, hits, strict=True) if not hit],
        "extra": [id for id in weighty if id not in [hit[0] for hit in hits if hit]],
        "seconds": round(result.seconds, 1),
    }
    print(json.dumps(row), flush=True)
    return row


if __name__ == "__main__":
    sys.exit(main())
