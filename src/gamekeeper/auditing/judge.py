"""Judging: checks over what was gathered, and verdicts from their cases. Pure."""

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from gamekeeper.checks.case import Case
from gamekeeper.checks.check import Check
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.verdict import NO_CASE, SEVERITIES, Finding, Outcome, Severity, Verdict
from gamekeeper.contract import Contract

MOST_SHOWN: Final = 3
"""Broken cases of one check that become findings, each of another field."""
FAR: Final = 1 << 60
NOISE: Final = "the same seed and actions give another episode each time, so none can be compared"
LEAKS: Final = (
    "the same seed and actions give another episode in an instance that was used before (see "
    "GK604), so that episodes can't be compared"
)

NOT_COMPARED: Final = frozenset({"metadata", "spaces", "surface"})
"""Probes whose facts are of single calls: they see something where plays show nothing."""

WANTED: Final = {
    "alternated": "a second instance that can be built, reset and stepped beside the first",
    "alternatives": "a payment of a term that the contract declares to be its earner's",
    "books": "a turn before which a reward other than 0 is paid",
    "conversion": "metadata that say is_parallelizable, in an environment that can be converted",
    "copies": "a copy that can be made in mid-episode and stepped",
    "evidence": "an episode that can be recorded",
    "extra_calls": "the call in question, which the environment has to offer",
    "generators": "an episode that repeats where nothing is changed",
    "handed_over": "an action, or options, that can be written into",
    "illegal": "an action that is outside its space, or that a mask forbids",
    "influence": "an action that, replaced alone, moves what another agent is given",
    "kept": "an array or a dictionary that is handed out and followed by another turn",
    "lifecycle": "an episode that can be reset in its midst and played to its end",
    "metadata": "metadata of the environment's class",
    "order": "a tick in which two agents act",
    "other_process": "an episode that repeats in this process and can be played in another",
    "payment_times": "a reward that lies far from what its agent gets in most steps",
    "render": "a render mode that the metadata declare and that can be built",
    "same_seed": "an episode that can be played twice",
    "second_episode": "an episode that repeats in a fresh instance, by a seed that isn't ignored",
    "spaces": "an agent with spaces, and a value of them",
    "special_seeds": "an ordinary seed with which an episode repeats",
    "state": "a state() that returns a value",
    "surface": "a reset and a step that return without an error",
    "unseeded": "an episode in which something is drawn",
    "written": "an array in an observation, an info or state() that can be written into",
}
"""Needs of a probe for a case, by its name; said where a check has no words of its own."""


@dataclass(frozen=True, slots=True)
class Judged:
    """Outcome of a check before its cases are shrunk."""

    check: Check
    outcome: Outcome
    cases: int = 0
    failed: int = 0
    shown: tuple[Case, ...] = ()
    confidence: float = 1.0
    reason: str = ""
    severity: Severity | None = None


def verdict_of(judged: Judged, findings: tuple[Finding, ...]) -> Verdict:
    """The verdict of a judged check, with its findings."""
    check = judged.check
    told = check.id, check.claim, judged.outcome, judged.severity or check.severity
    counts = judged.confidence, judged.cases, judged.failed
    return Verdict(*told, *counts, findings, judged.reason)


def judge(
    check: Check, contract: Contract, evidence: ProbeEvidence, broken_probes: Mapping[str, str]
) -> Judged:
    """Runs one check; what it raises is an *error* of its own, never the environment's fault."""
    failed = [name for name in check.needs if name in broken_probes]
    if failed:
        return Judged(check, "error", reason=broken_probes[failed[0]])
    try:
        against = check.reason_against(contract, evidence)
        if against is not None:
            return Judged(check, "not_applicable", reason=against)
        cases, bad = 0, []
        for case in check.run(contract, evidence):  # the good ones are counted, not kept
            cases += 1
            if not case.ok:
                bad.append(case)
    except Exception:  # a third party's check may raise anything
        return Judged(check, "error", reason=traceback.format_exc())
    waiver = contract.waivers.get(check.id)
    if bad:
        sure = max(each.confidence or check.confidence for each in bad)
        outcome: Outcome = "failed" if waiver is None else "waived"
        shown, worst = _first_by_field(bad, check), min(bad, key=_badness(check))
        reason = check.doubt if waiver is None else waiver
        counts = cases, len(bad)
        return Judged(check, outcome, *counts, shown, sure, reason, worst.severity)
    if not cases:
        return Judged(check, "not_exercised", reason=_not_exercised(check, evidence))
    if evidence.blind and not NOT_COMPARED.issuperset(check.needs):
        return Judged(check, "not_exercised", reason=evidence.blind)
    reason = "" if waiver is None else f"its waiver isn't needed any more ({waiver})"
    return Judged(check, "passed", cases, reason=reason)


def _not_exercised(check: Check, evidence: ProbeEvidence) -> str:
    reasons = [
        evidence.not_exercised[name] for name in check.needs if name in evidence.not_exercised
    ]
    if reasons:
        return reasons[0]
    pairs = (each for name in check.needs for each in evidence.counterfactuals(name))
    is_noisy = any(each.noise is not None for each in pairs)
    if is_noisy:
        again = list(evidence.counterfactuals("same_seed"))
        return LEAKS if again and all(each.divergence is None for each in again) else NOISE
    probed = (WANTED[name] for name in check.needs if name in WANTED)
    wanted = check.looks_at or next(probed, "")
    return f"{NO_CASE}: {wanted}" if wanted else NO_CASE


def _badness(check: Check) -> Callable[[Case], int]:
    """Order of cases by severity, the worst first."""
    return lambda case: SEVERITIES.index(case.severity or check.severity)


def _first_by_field(bad: list[Case], check: Check) -> tuple[Case, ...]:
    """The earliest of the worst broken cases of each field, the worst and earliest first."""
    badness = _badness(check)
    firsts: dict[str, Case] = {}
    for case in sorted(bad, key=lambda case: (badness(case), *_earliness(case))):
        firsts.setdefault(case.where.field, case)
    return tuple(firsts.values())[:MOST_SHOWN]


def _earliness(case: Case) -> tuple[int, int]:
    turn = case.where.turn
    return (FAR if turn is None else turn, case.where.play)
