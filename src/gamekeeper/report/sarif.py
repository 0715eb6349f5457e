"""An audit as SARIF 2.1.0, which code hosts show beside the lines of a change.

Source: OASIS, Static Analysis Results Interchange Format (SARIF) Version 2.1.0, 2023.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

Document = Mapping[str, Any]

SCHEMA: Final = "https://json.schemastore.org/sarif-2.1.0.json"
VERSION: Final = "2.1.0"
LEVELS: Final = {"high": "error", "medium": "warning", "low": "note"}
KINDS: Final = {"broken": "fail", "waived": "fail"}
"""Outcomes that are results; the others are no news to a code host."""


def sarif_json(
    audits: Sequence[Document], *, version: str, places: Sequence[str | None] = ()
) -> str:
    """The document: a run with a rule for each check, a result for each finding.

    Waived findings are results too, suppressed with the contract's reason.

    Args:
        audits: documents of audits.
        version: of Gamekeeper.
        places: for each audit the address of the file with its rules: relative to the root of the
            sources where it lies inside, else absolute; None where there is no file.
    """
    where = [*places, *[None] * (len(audits) - len(places))]
    rules = _rules(audits)
    numbers = {rule["id"]: number for number, rule in enumerate(rules)}
    results = [
        result
        for audit, place in zip(audits, where, strict=True)
        for verdict in audit["verdicts"]
        if verdict["outcome"] in KINDS
        for result in _results(audit, verdict, numbers, place)
    ]
    driver = {"name": "gamekeeper", "semanticVersion": version, "rules": rules}
    failed = any(x["outcome"] == "error" for audit in audits for x in audit["verdicts"])
    run = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "invocations": [{"executionSuccessful": not failed}],
        "results": results,
    }
    return json.dumps({"$schema": SCHEMA, "version": VERSION, "runs": [run]}, indent=2) + "\n"


def _rules(audits: Sequence[Document]) -> list[dict[str, Any]]:
    verdicts = {each["id"]: each for audit in audits for each in audit["verdicts"]}
    return [
        {
            "id": id,
            "shortDescription": {"text": each["claim"]},
            "help": {"text": f"gamekeeper explain {id}"},
            "defaultConfiguration": {"level": LEVELS[each["severity"]]},
            "properties": {"severity": each["severity"]},
        }
        for id, each in sorted(verdicts.items())
    ]


def _results(
    audit: Document, verdict: Document, numbers: Mapping[str, int], place: str | None
) -> list[dict[str, Any]]:
    findings = verdict["findings"] or [dict.fromkeys(("where", "expected", "seen", "mend"), "")]
    return [_result(audit, verdict, each, numbers[verdict["id"]], place) for each in findings]


def _result(
    audit: Document, verdict: Document, finding: Document, number: int, place: str | None
) -> dict[str, Any]:
    name = f"{audit['environment']} ({audit['api']})"
    result: dict[str, Any] = {
        "ruleId": verdict["id"],
        "ruleIndex": number,
        "kind": KINDS[verdict["outcome"]],
        "level": LEVELS[verdict["severity"]],
        "message": {"text": _message(verdict, finding)},
        "locations": [_location(audit, finding, place)],
        # The place in a play moves with every change of a rule; the field stays.
        "partialFingerprints": {"check/v1": f"{verdict['id']}:{name}:{_field(finding['where'])}"},
        "properties": {
            "environment": audit["environment"],
            "confidence": verdict["confidence"],
            "reproduce": finding.get("reproduce", ""),
        },
    }
    if verdict["outcome"] == "waived":
        result["suppressions"] = [{"kind": "external", "justification": verdict["reason"]}]
    return result


def _message(verdict: Document, finding: Document) -> str:
    parts = [verdict["claim"]]
    if finding["where"]:
        parts.append(
            f"At {finding['where']}: expected {finding['expected']}, seen {finding['seen']}."
        )
    if finding["mend"]:
        parts.append(f"Mend: {finding['mend']}.")
    return " ".join(parts)


def _location(audit: Document, finding: Document, place: str | None) -> dict[str, Any]:
    source = audit.get("source") or {}
    logical: dict[str, Any] = {"name": audit["environment"], "kind": "module"}
    if "class" in source:
        logical |= {"fullyQualifiedName": source["class"], "kind": "type"}
    location: dict[str, Any] = {"logicalLocations": [logical]}
    if place is not None:
        artifact: dict[str, Any] = {"uri": place}
        if ":" not in place:
            artifact["uriBaseId"] = "%SRCROOT%"
        region = {"startLine": max(int(source.get("line", 1)), 1)}
        location["physicalLocation"] = {"artifactLocation": artifact, "region": region}
    if finding["where"]:
        location["message"] = {"text": finding["where"]}
    return location


def _field(where: str) -> str:
    """The field without agent and turn: `rewards` of `rollout/7, turn 8, rewards['rover_1']`."""
    return where.rpartition(", ")[2].partition("[")[0]
