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

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from diagnosed_table import CAUSES, answer_of, options_of, shares, table
from fresh_causes import FAILED, FreshCause, causes, holds


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
    parser = options_of(str(__doc__), "fresh.jsonl")
    parser.add_argument("--part", default="0/1")
    parser.add_argument("--only", default="", help="set-ups with this in their name")
    options = parser.parse_args()
    place, parts = map(int, options.part.split("/"))

    def answer(case: FreshCause) -> dict[str, Any]:
        return answer_of(case.env, case.policies, options, failed=FAILED, kwargs=case.kwargs)

    table(
        "fresh",
        [each for each in causes() if options.only in each.name][place::parts],
        options,
        holds=holds,
        fields=("kind", "agents", "labels"),
        answer=answer,
        summary=summary,
    )


if __name__ == "__main__":
    main()
