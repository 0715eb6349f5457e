"""Two faults at once: each faulty environment, with actions that slip by a generator nobody seeded.

    python benchmarks/two_faults.py [--every 3] [--json FILE]

An audit is right where the slip (GK601) is a cause, and the planted fault has failed too, as
another cause or as what follows from one that goes with it. Of a check that can't be certain,
suspected is enough. Environments whose own fault is one of seeds are left out, as the slip is
another of the same kind.
"""

import argparse
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from gamekeeper.auditing.audit_process import audit
from gamekeeper.checks.check import checks
from tests.faults import Faulty, environments
from tests.faults.rovers import Rovers

SLIP = 0.1
WORKERS = 2


class Slips(Rovers):
    """One action in ten is replaced by standing still, in no seed's hand."""

    def drive(self, agent: str, action: int) -> None:
        """Slips now and then."""
        slips = np.random.default_rng().random() < SLIP
        super().drive(agent, 0 if slips else action)


def _both() -> dict[str, Faulty]:
    """Environments in this module by their names, each with its planted fault.

    They slip in the last of their classes that drives: one that drives by itself doesn't hide it.
    """
    found = {}
    for name, each in environments().items():
        if not issubclass(each.env, Rovers) or any(id.startswith("GK60") for id in each.checks):
            continue
        if each.checks and each.declared is None:
            globals()[f"{name}Slips"] = type(f"{name}Slips", (each.env, Slips), {})
            found[f"{name}Slips"] = each
    return found


BOTH = _both()


def judged(name: str, budget: int) -> dict[str, Any]:
    """The causes and the consequences that the audit of one of them gives."""
    each = BOTH[name]
    # its budget is of one fault: what two of them take is twice as much
    found = audit(f"benchmarks.two_faults:{name}", budget=max(budget, 2 * each.budget))
    causes = [verdict.id for verdict in found.failed if verdict.follows_from is None]
    broken = {verdict.id for verdict in found.failed}
    broken |= {v.id for v in found.verdicts if v.outcome == "suspected" and checks()[v.id].doubt}
    both = "GK601" in causes and broken >= set(each.checks)
    return {
        "name": name,
        "planted": [*each.checks, "GK601"],
        "causes": causes,
        "consequences": sorted(broken - set(causes)),
        "both": both,
        "only_both": both and set(causes) <= {*each.checks, *each.also, "GK601"},
    }


def main() -> None:
    """Audits them, and prints what wasn't found and how many were."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="audit every n-th (default: 1)")
    parser.add_argument("--budget", type=int, default=3_000, help="env steps (default: 3000)")
    parser.add_argument("--json", type=Path, help="file for the results (default: none)")
    asked = parser.parse_args()
    names = list(BOTH)[:: asked.every]
    with ThreadPoolExecutor(WORKERS) as pool:
        rows = list(pool.map(lambda name: judged(name, asked.budget), names))
    for row in rows:
        if not row["only_both"]:
            print(f"{row['name']}: planted {row['planted']}, causes {row['causes']}")
    both, only = (sum(row[key] for row in rows) for key in ("both", "only_both"))
    print(f"{len(rows)} environments: both causes in {both}, nothing else in {only}")
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
