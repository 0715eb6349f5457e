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

import random
import sys
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from diagnosed_table import CAUSES, ORDER, answer_of, options_of, shares, table
from learnt_policies import LearntCause, causes, holds
from undo_causes import Faulty


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
    parser = options_of(str(__doc__), "learnt.jsonl")
    parser.add_argument("--folder", type=Path, default=Path("learnt"))
    parser.add_argument("--beside", action="store_true", help="try the sound policy too")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    cases = list(causes(options.folder))
    random.Random(ORDER).shuffle(cases)

    def answer(case: LearntCause) -> dict[str, Any]:
        beside = {"*": Faulty(case.sound)} if options.beside else None
        return answer_of(case.env, case.policies, options, failed=case.failed, replace=beside)

    table(
        "learnt policies, beside a sound one" if options.beside else "learnt policies",
        cases,
        options,
        holds=holds,
        fields=("agents", "labels", "is_restored"),
        answer=answer,
        summary=summary,
    )


if __name__ == "__main__":
    main()
