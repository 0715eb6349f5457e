"""The same audit again and again, on a machine that is idle and on one that is busy.

    python benchmarks/audit_repeats.py [--repeats 10] [--load 0 8] [--budget 3000] [--only WORD ...]

Of a sound environment all verdicts must be the same each time, of one that gives another episode
each time all causes. One JSON line for each environment: {"figure", "environment", "kind",
"repeats", "loads", "same", "differing": {id: {outcome: times}}, "seconds": {load: mean}}. Exits 1
where anything differs. The load is that many processes that count, beside whatever else runs.
"""

import argparse
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.two_faults import Slips
from gamekeeper.auditing.audit_process import audit
from gamekeeper.auditing.result import AuditResult
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders

HERE: Final = "benchmarks.audit_repeats"
BUSY: Final = "while True: pass"


class SlippingRovers(Slips, Rovers):
    """Rovers whose actions slip now and then, in no seed's hand."""


class GlobalTraders(Traders):
    """Traders of whom one finds a coin by the global generator."""

    def settle(self) -> None:
        """Somebody finds a coin."""
        super().settle()
        self.money[self.possible_agents[np.random.randint(self.count)]] += 1


SOUND: Final = (
    "tests.faults.rovers:Rovers",
    "tests.faults.traders:Traders",
    "two_robot_line",
    "mpe2.simple_spread_v3:parallel_env",
)
NONDETERMINISTIC: Final = (f"{HERE}:SlippingRovers", f"{HERE}:GlobalTraders")


def main() -> int:
    """Audits all of them; 1 where an audit differs from another of the same environment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=10, help="audits at each load (default: 10)")
    parser.add_argument("--load", type=int, nargs="+", default=[0, 8], help="busy processes")
    parser.add_argument("--budget", type=int, default=3_000, help="env steps (default: 3000)")
    parser.add_argument(
        "--only", nargs="*", default=[], help="words, one of which a name must hold"
    )
    asked = parser.parse_args()
    is_same = True
    for kind, specs in (("sound", SOUND), ("nondeterministic", NONDETERMINISTIC)):
        for spec in specs:
            if not asked.only or any(word in spec for word in asked.only):
                row = repeated(spec, kind, asked.repeats, asked.load, asked.budget)
                is_same &= bool(row["same"])
                print(json.dumps(row), flush=True)
    return 0 if is_same else 1


def repeated(
    spec: str, kind: str, repeats: int, loads: Sequence[int], budget: int
) -> dict[str, Any]:
    """The audits of one environment, and what differs among them."""
    seen: list[Mapping[str, str]] = []
    seconds: dict[str, float] = {}
    for load in loads:
        with busy(load):
            found = [audit(spec, budget=budget) for _ in range(repeats)]
        seen += [outcomes(each, only_causes=kind != "sound") for each in found]
        seconds[str(load)] = round(sum(each.seconds for each in found) / repeats, 1)
    differing = dict(differences(seen))
    return {
        "figure": "audits that repeat",
        "environment": spec,
        "kind": kind,
        "repeats": repeats,
        "loads": list(loads),
        "same": not differing,
        "differing": differing,
        "seconds": seconds,
    }


def outcomes(result: AuditResult, *, only_causes: bool) -> dict[str, str]:
    """Outcomes by check, with the cause of a consequence; or the causes alone."""
    found = {}
    for each in result.verdicts:
        if each.follows_from is not None:
            found[each.id] = f"{each.outcome}, follows from {each.follows_from.id}"
        elif not only_causes or each.outcome == "failed":
            found[each.id] = each.outcome
        elif each.outcome == "error":
            found[each.id] = f"error: {each.reason.splitlines()[-1:]}"
    if only_causes:
        return {id: outcome for id, outcome in found.items() if "follows" not in outcome}
    return found


def differences(seen: Sequence[Mapping[str, str]]) -> Iterator[tuple[str, dict[str, int]]]:
    """Checks whose outcome isn't the same each time, with how often each came."""
    for id in sorted({id for each in seen for id in each}):
        counts = Counter(each.get(id, "no cause") for each in seen)
        if len(counts) > 1:
            yield id, dict(counts)


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Within it that many processes count, and do nothing else."""
    processes = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for each in processes:
            each.kill()
            each.wait()


if __name__ == "__main__":
    sys.exit(main())
