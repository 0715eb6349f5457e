"""An audit as JUnit XML, which build servers show as tests: one for each check.

Source: the schema that Jenkins and GitLab read, https://github.com/testmoapp/junitxml.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final
from xml.etree import ElementTree as Tree

Document = Mapping[str, Any]

NO_SIGNS: Final = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What no XML document may hold. Source: XML 1.0, 2.2."""


def junit_xml(audits: Sequence[Document]) -> str:
    """The document: a suite for each audit, a case for each of its checks.

    Broken is a failure, an error of a check's own is an error; unseen, not applicable and waived
    are skipped, with the reason.
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
    suite = Tree.Element("testsuite", {
        "name": _text(audit["environment"]),
        "tests": str(len(outcomes)),
        "failures": str(outcomes.count("broken")),
        "errors": str(outcomes.count("error")),
        "skipped": str(sum(map(outcomes.count, ("unseen", "not_applicable", "waived")))),
        "time": f"{audit['seconds']:.3f}",
    })  # fmt: skip
    properties = Tree.SubElement(suite, "properties")
    for name in ("api", "seed", "steps"):
        Tree.SubElement(properties, "property", {"name": name, "value": _text(audit[name])})
    suite.extend(_case(audit, verdict) for verdict in audit["verdicts"])
    return suite


def _case(audit: Document, verdict: Document) -> Tree.Element:
    source = audit.get("source") or {}
    case = Tree.Element("testcase", {
        "classname": _text(audit["environment"]),
        "name": _text(f"{verdict['id']} {verdict['claim']}"),
        "time": "0",
    })  # fmt: skip
    if "file" in source:
        case.set("file", _text(source["file"]))
        case.set("line", str(source.get("line", 1)))
    outcome = verdict["outcome"]
    if outcome == "broken":
        findings = verdict["findings"]
        message = _at(findings[0]) if findings else verdict["claim"]
        failure = Tree.SubElement(
            case, "failure", {"message": _text(message), "type": verdict["severity"]}
        )
        failure.text = _text("\n\n".join(map(_told, findings)))
    elif outcome == "error":
        last = (verdict["reason"].strip().splitlines() or [""])[-1]
        error = Tree.SubElement(case, "error", {"message": _text(last), "type": "check"})
        error.text = _text(verdict["reason"])
    elif outcome != "kept":
        reason = f"{outcome.replace('_', ' ')}: {verdict['reason']}"
        Tree.SubElement(case, "skipped", {"message": _text(reason)})
    return case


def _at(finding: Document) -> str:
    return f"{finding['where']}: expected {finding['expected']}, seen {finding['seen']}"


def _told(finding: Document) -> str:
    mend = f"mend: {finding['mend']}\n" if finding["mend"] else ""
    return f"{_at(finding)}\n{mend}\n{finding['reproduce']}"


def _text(value: object) -> str:
    """The value without signs that XML can't hold."""
    return NO_SIGNS.sub("\ufffd", str(value))
