"""Documents of audits as reports take them, made by hand."""

from typing import Any

PROGRAM = "SEED = 7\nassert False\n"


def finding(**fields: Any) -> dict[str, Any]:
    """A finding; `fields` in place of the usual ones."""
    usual = {
        "where": "rollout/7, turn 8, rewards['rover_1']",
        "expected": "0.0",
        "actual": "0.5",
        "fix": "pay an agent 0 once it has ended",
        "reproducer": PROGRAM,
    }
    return {**usual, **fields}


def verdict(id: str, outcome: str, **fields: Any) -> dict[str, Any]:
    """A verdict; broken and waived ones have a finding."""
    is_bad = outcome in ("failed", "waived")
    usual = {
        "id": id,
        "claim": f"The promise of {id}.",
        "outcome": outcome,
        "severity": "high",
        "confidence": 1.0,
        "cases": 260,
        "failed": 30 if is_bad else 0,
        "findings": [finding()] if is_bad else [],
        "reason": "" if outcome in ("failed", "passed") else f"why {id} is {outcome}",
        "reproduced": {"failed": 5, "tried": 5, "unchanged_passed": None} if is_bad else None,
        "follows_from": None,
    }
    return {**usual, **fields}


def audit(*verdicts: dict[str, Any], **fields: Any) -> dict[str, Any]:
    """The document of an audit."""
    usual = {
        "environment": "rovers.py:make",
        "api": "parallel",
        "ok": all(each["outcome"] not in ("failed", "error") for each in verdicts),
        "seconds": 1.25,
        "steps": 3_000,
        "seed": 0,
        "verdicts": list(verdicts),
        "measured": {},
        "timings": {"rollout": 1.0, "judging": 0.25},
        "agents": {},
        "declared": None,
        "source": {"class": "rovers.Rovers", "file": "rovers.py", "line": 12},
        "stopped": "",
        "prints": "",
    }
    return {**usual, **fields}


def mixed() -> dict[str, Any]:
    """An audit with every outcome, and broken promises of two severities."""
    return audit(
        verdict("GK101", "passed"),
        verdict("GK201", "not_exercised"),
        verdict("GK301", "not_applicable"),
        verdict("GK402", "failed"),
        verdict("GK501", "waived"),
        verdict("GK502", "error", reason="Traceback ...\nNameError: name 'x' is not defined"),
        verdict("GK821", "failed", severity="low", findings=[finding(actual="None", where="b")]),
    )
