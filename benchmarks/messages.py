"""How often a diagnosis with nothing declared is right of messages: misread, lost, late, garbled.

The set-ups come from message_causes.py; they were written, and kept, before the rules for messages
were. Each that is what it claims to be is recorded for 10 episodes and diagnosed without a
contract, a reference or a knob. Prints a JSON line for each (also into `--keep`, from which a
second call goes on), then the shares with Wilson intervals:

- *named*: of failing set-ups, those for which a cause is named;
- *right*: of those, the faulty agent alone is named, or that its messages with another agent are
  misread, lost or late, which can't always be told apart; of a fault of the air the messages;
- *agent alone right*: of those with an agent's fault in which one agent alone is named, the
  faulty one is;
- *label right*: of answers with one label (isolated, joint), those that have the planted one;
- *healthy accused*: of healthy set-ups, those in which a cause is named.

    python benchmarks/messages.py [--episodes 1000] [--seed 0] [--seconds 170]
        [--keep messages.jsonl] [--kinds said heard air other healthy]
"""

import random
import sys
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from diagnosed_table import CAUSES, ORDER, answer_of, options_of, shares, table
from message_causes import FAILED, causes, holds


def is_right(row: dict[str, Any]) -> bool:
    """Names the faulty agent alone, or the messages that it says or hears, or the air takes."""
    if row["whom"] == row["agents"] and row["agents"]:
        return True
    ends = {f"messages from {row['between'][0]} to"} if row["between"] else set[str]()
    ends |= {f"messages from {agent} to" for agent in row["agents"]}
    told = any(end in row["component"] for end in ends)
    told = told or any(_hears(row["component"], agent) for agent in row["agents"])
    return told and set(row["agents"]) <= {*row["whom"]} | (set() if row["whom"] else {""})


def _hears(component: str, agent: str) -> bool:
    """Messages to an agent are named."""
    parts = component.split("messages from ")[1:]
    return any(agent in part.partition(" to ")[2] for part in parts)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The shares, with Wilson intervals."""
    failing = [row for row in rows if row["kind"] != "healthy"]
    sound = [row for row in rows if row["kind"] == "healthy"]
    named = [row for row in failing if row["answer"] in CAUSES]
    alone = [row for row in named if len(row["whom"]) == 1 and "messages" not in row["component"]]
    labelled = [row for row in named if row["said"] and row["answer"] != "ambiguous"]
    counts = {
        "named": (len(named), len(failing)),
        "right": (sum(map(is_right, named)), len(named)),
        "agent alone right": (sum(row["whom"] == row["agents"] for row in alone), len(alone)),
        "label right": (sum(row["said"] == row["labels"] for row in labelled), len(labelled)),
        "healthy accused": (sum(row["answer"] in CAUSES for row in sound), len(sound)),
    }
    return shares(counts)


def main() -> None:
    """Plays what is wanted and says how often it was right."""
    parser = options_of(str(__doc__), "messages.jsonl")
    kinds = ["said", "heard", "air", "other", "healthy"]
    parser.add_argument("--kinds", nargs="+", default=kinds, choices=kinds)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    cases = [each for each in causes() if each.kind in options.kinds]
    random.Random(ORDER).shuffle(cases)
    table(
        "messages",
        cases,
        options,
        holds=holds,
        fields=("kind", "agents", "between", "labels"),
        answer=lambda case: answer_of(case.env, case.policies, options, failed=FAILED),
        summary=summary,
    )


if __name__ == "__main__":
    main()
