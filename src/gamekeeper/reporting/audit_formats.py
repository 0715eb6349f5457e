"""An audit as JUnit XML, which build servers show as tests: one for each check.

Source: the schema that Jenkins and GitLab read, https://github.com/testmoapp/junitxml.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final
from xml.etree import ElementTree as Tree

Document = Mapping[str, Any]

NO_SIGNS: Final = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold. Source: XML 1.0, 2.2."""


def junit_xml(audits: Sequence[Document]) -> str:
    """The document: a suite for each audit, a case for each of its checks.

    Failed is a failure, an error of a check's own is an error; not exercised, not applicable
    and waived are skipped, with the reason.
    """
    suites = [_suite(audit) for audit in audits]
    totals = {
        name: str(sum(int(suite.attrib[name]) for suite in suites))
        for name in ("tests", "failures", "errors", "skipped")
    }
    root = Tree.Element("testsuites", {"name": "gamekeeper audit", **totals})
    root.set("time", f"{sum(float(audit['seconds']) for audit in audits):.3f}")
    root.extend(suites)
    Tree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{Tree.tostring(root, encoding="unicode")}\n'


def _suite(audit: Document) -> Tree.Element:
    outcomes = [each["outcome"] for each in audit["verdicts"]]
    suite = Tree.Element(
        "testsuite",
        {
            "name": _text(audit["environment"]),
            "tests": str(len(outcomes)),
            "failures": str(outcomes.count("failed")),
            "errors": str(outcomes.count("error")),
            "skipped": str(
                sum(map(outcomes.count, ("suspected", "not_exercised", "not_applicable", "waived")))
            ),
            "time": f"{audit['seconds']:.3f}",
        },
    )
    properties = Tree.SubElement(suite, "properties")
    for name in ("api", "seed", "steps"):
        Tree.SubElement(properties, "property", {"name": name, "value": _text(audit[name])})
    suite.extend(_case(audit, verdict) for verdict in audit["verdicts"])
    return suite


def _case(audit: Document, verdict: Document) -> Tree.Element:
    source = audit.get("source") or {}
    case = Tree.Element(
        "testcase",
        {
            "classname": _text(audit["environment"]),
            "name": _text(f"{verdict['id']} {verdict['claim']}"),
            "time": "0",
        },
    )
    if "file" in source:
        case.set("file", _text(source["file"]))
        case.set("line", str(source.get("line", 1)))
    outcome = verdict["outcome"]
    if outcome == "failed":
        findings = verdict["findings"]
        message = _at(findings[0]) if findings else verdict["claim"]
        failure = Tree.SubElement(
            case, "failure", {"message": _text(message), "type": verdict["severity"]}
        )
        failure.text = _text("\n\n".join(map(_finding_text, findings)))
    elif outcome == "error":
        last = (verdict["reason"].strip().splitlines() or [""])[-1]
        error = Tree.SubElement(case, "error", {"message": _text(last), "type": "check"})
        error.text = _text(verdict["reason"])
    elif outcome != "passed":
        reason = f"{outcome.replace('_', ' ')}: {verdict['reason']}"
        Tree.SubElement(case, "skipped", {"message": _text(reason)})
    return case


def _at(finding: Document) -> str:
    return f"{finding['where']}: expected {finding['expected']}, actual {finding['actual']}"


def _finding_text(finding: Document) -> str:
    fix = f"fix: {finding['fix']}\n" if finding["fix"] else ""
    return f"{_at(finding)}\n{fix}\n{finding['reproducer']}"


def _text(value: object) -> str:
    """The value without characters that XML can't hold."""
    return NO_SIGNS.sub("\ufffd", str(value))


SCHEMA: Final = "https://json.schemastore.org/sarif-2.1.0.json"
VERSION: Final = "2.1.0"
LEVELS: Final = {"high": "error", "medium": "warning", "low": "note"}
KINDS: Final = {"failed": "fail", "waived": "fail"}
"""Outcomes that are results; a code host shows no others."""


def sarif_json(
    audits: Sequence[Document], *, version: str, address: Callable[[str], str] = str
) -> str:
    """The document: a run with a rule for each check, a result for each finding.

    Waived findings are results too, suppressed with the contract's reason.

    Args:
        address: gives the address of a file: relative to the root of the sources where it lies
            inside, else absolute.
    """
    rules = _rules(audits)
    numbers = {rule["id"]: number for number, rule in enumerate(rules)}
    results = [
        result
        for audit in audits
        for verdict in audit["verdicts"]
        if verdict["outcome"] in KINDS
        for result in _results(audit, verdict, numbers, address)
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
    audit: Document, verdict: Document, numbers: Mapping[str, int], address: Callable[[str], str]
) -> list[dict[str, Any]]:
    findings = verdict["findings"] or [dict.fromkeys(("where", "expected", "actual", "fix"), "")]
    number = numbers[verdict["id"]]
    return [
        _result(audit, verdict, each, number, _locations(audit, each, address)) for each in findings
    ]


def _result(
    audit: Document,
    verdict: Document,
    finding: Document,
    number: int,
    locations: Sequence[Document],
) -> dict[str, Any]:
    name = f"{audit['environment']} ({audit['api']})"
    # Without agent and turn: `rewards` of `rollout/7, turn 8, rewards['rover_1']`.
    field = finding["where"].rpartition(", ")[2].partition("[")[0]
    result: dict[str, Any] = {
        "ruleId": verdict["id"],
        "ruleIndex": number,
        "kind": KINDS[verdict["outcome"]],
        "level": LEVELS[verdict["severity"]],
        "message": {"text": _message(verdict, finding)},
        "locations": list(locations),
        # The turn of a finding moves with every change of a rule; the field stays.
        "partialFingerprints": {"check/v1": f"{verdict['id']}:{name}:{field}"},
        "properties": {
            "environment": audit["environment"],
            "confidence": verdict["confidence"],
            "reproducer": finding.get("reproducer", ""),
        },
    }
    if verdict["outcome"] == "waived":
        result["suppressions"] = [{"kind": "external", "justification": verdict["reason"]}]
    return result


def _message(verdict: Document, finding: Document) -> str:
    parts = [verdict["claim"]]
    if finding["where"]:
        parts.append(f"At {_at(finding)}.")
    if finding["fix"]:
        parts.append(f"Fix: {finding['fix']}.")
    return " ".join(parts)


def _locations(
    audit: Document, finding: Document, address: Callable[[str], str]
) -> list[dict[str, Any]]:
    """The lines that do it, where they are known; else that of the environment's class."""
    source = audit.get("source") or {}
    logical: dict[str, Any] = {"name": audit["environment"], "kind": "module"}
    if "class" in source:
        logical |= {"fullyQualifiedName": source["class"], "kind": "type"}
    common: dict[str, Any] = {"logicalLocations": [logical]}
    if finding["where"]:
        common["message"] = {"text": finding["where"]}
    places = [line.rpartition(":") for line in finding.get("lines") or ()]
    if not places and "file" in source:
        places = [(source["file"], ":", source.get("line", 1))]
    return [
        {**common, "physicalLocation": _physical(address(file), max(int(line), 1))}
        for file, _, line in places
    ] or [common]


def _physical(uri: str, line: int) -> dict[str, Any]:
    base = {} if ":" in uri else {"uriBaseId": "%SRCROOT%"}
    return {"artifactLocation": {"uri": uri, **base}, "region": {"startLine": line}}
