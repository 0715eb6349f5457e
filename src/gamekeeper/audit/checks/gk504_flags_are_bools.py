"""GK504."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._entries import has_odd_rows
from gamekeeper.core.canon import shown
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

BOOKS: Final = {"terminated": "terminations", "truncated": "truncations"}


@check(
    "GK504",
    needs=("rollout",),
    severity=MEDIUM,
    mend="make a bool of it: `terminations[agent] = bool(...)`",
)
def flags_are_bools(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Terminations and truncations are bools (Python's or NumPy's), not numbers, None or arrays.

    `flag is True`, `~flag` and masks of arrays mean something else for 1 than for True, and None or
    an array isn't an answer at all.

    Bad: `terminations[agent] = self.steps // 100`.

    Good: `terminations[agent] = self.steps >= 100`.
    """
    for trace in evidence["rollout"]:
        is_odd = has_odd_rows(trace)
        for turn in trace.turns:
            bad = [
                (agent, name, odd[name])
                for agent, odd in (turn.odd.items() if is_odd else ())
                for name in BOOKS
                if odd.get(name, {}).get("type", "missing") != "missing"
            ]
            for agent, name, flag in bad:
                yield Occasion(
                    trace.at(turn, agent, BOOKS[name]), False, "a bool",
                    f"{flag['type']}: {shown(flag.get('value'))}", proof=_proof(evidence.api, name),
                )  # fmt: skip
            if not bad and (turn.terminated or turn.truncated):
                yield Occasion(trace.at(turn, None, "terminations"), True)


def _proof(api: str, name: str) -> str:
    book = BOOKS[name] if api == "parallel" else f"env.{BOOKS[name]}"
    return (
        f"flags = {book}\n"
        "odd = {a: flags[a] for a in flags if not isinstance(flags[a], (bool, np.bool_))}\n"
        "assert not odd, odd"
    )
