"""Judging: checks over what was gathered, and verdicts from their occasions. Pure."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gamekeeper.audit.check import Check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.verdict import Outcome

MOST_SHOWN: Final = 3
"""Broken occasions of one check that become findings, each of another field."""
FAR: Final = 1 << 60


@dataclass(frozen=True, slots=True)
class Judged:
    """What a check came to, before anybody looks for the shortest way to see it again."""

    check: Check
    outcome: Outcome
    occasions: int = 0
    broken: int = 0
    shown: tuple[Occasion, ...] = ()
    confidence: float = 1.0
    reason: str = ""


def judge(
    check: Check, contract: Contract, evidence: Gathered, broken_probes: Mapping[str, str]
) -> Judged:
    """Runs one check; what it raises is an *error* of its own, never the environment's fault."""
    failed = [name for name in check.needs if name in broken_probes]
    if failed:
        return Judged(check, "error", reason=broken_probes[failed[0]])
    try:
        against = check.reason_against(contract, evidence)
        if against is not None:
            return Judged(check, "not_applicable", reason=against)
        occasions = list(check.run(contract, evidence))
    except Exception:  # a third party's check may raise anything
        return Judged(check, "error", reason=traceback.format_exc())
    bad = [each for each in occasions if not each.ok]
    waiver = contract.waivers.get(check.id)
    if bad:
        sure = max(each.confidence or check.confidence for each in bad)
        outcome: Outcome = "broken" if waiver is None else "waived"
        return Judged(
            check, outcome, len(occasions), len(bad), _first_by_field(bad), sure, waiver or ""
        )
    if not occasions:
        return Judged(check, "unseen", reason=_unseen(check, evidence))
    reason = "" if waiver is None else f"its waiver isn't needed any more ({waiver})"
    return Judged(check, "kept", len(occasions), reason=reason)


def _unseen(check: Check, evidence: Gathered) -> str:
    reasons = [evidence.unseen[name] for name in check.needs if name in evidence.unseen]
    return reasons[0] if reasons else "nothing that was played gave an occasion to look"


def _first_by_field(bad: list[Occasion]) -> tuple[Occasion, ...]:
    """The earliest broken occasion of each field, the earliest first."""
    firsts: dict[str, Occasion] = {}
    for occasion in sorted(bad, key=_earliness):
        firsts.setdefault(occasion.where.field, occasion)
    return tuple(firsts.values())[:MOST_SHOWN]


def _earliness(occasion: Occasion) -> tuple[int, int]:
    turn = occasion.where.turn
    return (FAR if turn is None else turn, occasion.where.play)
