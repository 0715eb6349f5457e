"""GK401."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import Turn

NO_NUMBERS: Final = ("NoneType", "str", "bytes", "list", "tuple", "dict", "complex")
"""Types that are no real numbers, whatever they hold."""


@check(
    "GK401",
    needs=("rollout",),
    severity=HIGH,
    mend="pay a finite Python or NumPy number: 0.0 where nothing is paid, `float(...)` around an "
    "array of one element",
)
def rewards_are_numbers(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every reward is one finite real number: no None, no NaN or infinity, no array, no text.

    A single NaN in a batch makes every weight of a learner NaN; None and arrays crash it, or change
    the shape of what it stores. Numbers of NumPy and 0-d arrays are fine.

    Bad:
    ```python
    rewards[agent] = None if agent not in scored else 1.0
    rewards[agent] = gain / cost              # 0 / 0 of numpy is NaN
    rewards[agent] = np.array([1.0])
    ```
    Good:
    ```python
    rewards[agent] = 1.0 if agent in scored else 0.0
    rewards[agent] = gain / cost if cost else 0.0
    ```
    """
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            strange = _strange(turn)
            for agent, seen in strange.items():
                yield Occasion(
                    trace.at(turn, agent, "rewards"), False, "one finite real number", seen,
                    proof=_proof(evidence.api, agent),
                )  # fmt: skip
            for agent, reward in turn.rewards.items():
                if agent not in strange:
                    yield Occasion(
                        trace.at(turn, agent, "rewards"), math.isfinite(reward),
                        "one finite real number", reward, proof=_proof(evidence.api, agent),
                    )  # fmt: skip


def _strange(turn: Turn) -> dict[str, str]:
    """Rewards that are no numbers, in words, by agent; missing ones are another check's."""
    found = {}
    for agent, fields in turn.odd.items():
        entry = fields.get("reward")
        if entry is not None and "value" in entry and not _is_number(entry):
            found[agent] = f"{entry['value']!r} ({entry['type']})"
    return found


def _is_number(entry: dict[str, Any]) -> bool:
    if entry["type"] in NO_NUMBERS:
        return False
    value = entry["value"]
    if getattr(value, "shape", ()) != ():
        return False
    try:
        return math.isfinite(float(value))
    except (TypeError, ValueError):  # kept as words: another library's number, not judged
        return type(value).__name__ == "Opaque"


def _proof(api: str, agent: str) -> str:
    rewards = "rewards" if api == "parallel" else "env.rewards"
    return (
        f"reward = {{str(a): r for a, r in {rewards}.items()}}[{agent!r}]\n"
        "assert not isinstance(reward, str) and np.ndim(reward) == 0, repr(reward)\n"
        "assert np.isfinite(float(reward)), repr(reward)"
    )
