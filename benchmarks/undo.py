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

import random
import sys
import warnings
from itertools import chain
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from diagnosed_table import CAUSES, ORDER, answer_of, options_of, shares, table
from undo_causes import STACKS, healthy, holds, inside, undoable


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
    parser = options_of(str(__doc__), "undo.jsonl")
    parser.add_argument("--most", type=int, default=200, help="set-ups that are looked at")
    parser.add_argument("--kinds", nargs="+", default=["undoable", "inside", "healthy"])
    parser.add_argument("--envs", nargs="+", choices=STACKS, default=list(STACKS))
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of mpe2's Box spaces
    every = chain(undoable(), inside(), healthy())
    cases = [each for each in every if each.name.partition(":")[0] in options.envs]
    cases = [each for each in cases if each.kind in options.kinds]
    random.Random(ORDER).shuffle(cases)
    table(
        "undone from outside",
        cases[: options.most],
        options,
        holds=holds,
        fields=("kind", "agents", "labels"),
        answer=lambda case: answer_of(case.spec, case.policies, options, failed=case.failed),
        summary=summary,
    )


if __name__ == "__main__":
    main()
