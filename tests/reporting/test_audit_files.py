import json
from typing import Any
from xml.etree import ElementTree

from gamekeeper.reporting.audit_formats import junit_xml, sarif_json
from tests.reporting.audits import audit, finding, mixed, verdict


def sarif(*audits: dict[str, Any], **options: Any) -> Any:
    """The document, read again."""
    return json.loads(sarif_json(audits, version="0.1.0", **options))


def test_junit_has_a_case_for_each_check() -> None:
    """Suites and the whole count their cases as JUnit's readers do."""
    root = ElementTree.fromstring(junit_xml([mixed(), audit(verdict("GK101", "passed"))]))
    assert (root.tag, root.attrib["tests"], root.attrib["failures"]) == ("testsuites", "8", "2")
    first, second = root.findall("testsuite")
    assert first.attrib["name"] == "rovers.py:make"
    counted = {name: first.attrib[name] for name in ("tests", "failures", "errors", "skipped")}
    assert counted == {"tests": "7", "failures": "2", "errors": "1", "skipped": "3"}
    assert len(first.findall("testcase")) == 7
    assert len(second.findall("testcase")) == 1


def test_junit_tells_what_became_of_each_check() -> None:
    """Broken fails with the program, an error of a check's own errs, the rest is skipped."""
    root = ElementTree.fromstring(junit_xml([mixed()]))
    told = {
        case.attrib["name"].split()[0]: [(each.tag, each.attrib["message"]) for each in case]
        for case in root.iter("testcase")
    }
    where = "rollout/7, turn 8, rewards['rover_1']: expected 0.0, actual 0.5"
    assert told["GK101"] == []
    assert told["GK402"] == [("failure", where)]
    assert told["GK502"] == [("error", "NameError: name 'x' is not defined")]
    assert told["GK201"] == [("skipped", "not exercised: why GK201 is not_exercised")]
    assert told["GK501"] == [("skipped", "waived: why GK501 is waived")]
    assert "assert False" in "".join(root.itertext())


def test_junit_is_xml_whatever_an_environment_says() -> None:
    """Signs that no XML may hold are replaced."""
    document = audit(verdict("GK402", "failed", findings=[finding(actual="\x00\x1b<&]]>\ud800")]))
    root = ElementTree.fromstring(junit_xml([document]).encode())
    assert "<&]]>" in "".join(root.itertext())


def test_sarif_has_what_the_schema_requires() -> None:
    """Version, runs, a driver with a name, rules with ids, results with messages."""
    found = sarif(mixed())
    assert found["version"] == "2.1.0"
    (run,) = found["runs"]
    driver = run["tool"]["driver"]
    assert driver["name"] == "gamekeeper"
    rules = [rule["id"] for rule in driver["rules"]]
    assert rules == sorted(set(rules))
    assert run["invocations"] == [{"executionSuccessful": False}]
    for result in run["results"]:
        assert rules[result["ruleIndex"]] == result["ruleId"]
        assert result["message"]["text"]
        assert result["level"] in ("error", "warning", "note")
        assert result["kind"] == "fail"


def test_sarif_levels_follow_severity() -> None:
    """High is an error, low a note; what isn't broken or waived is no result."""
    (run,) = sarif(mixed())["runs"]
    levels = {result["ruleId"]: result["level"] for result in run["results"]}
    assert levels == {"GK402": "error", "GK501": "error", "GK821": "note"}


def test_sarif_suppresses_what_is_waived() -> None:
    """A waived finding is there, suppressed with the contract's reason."""
    (run,) = sarif(mixed())["runs"]
    by_id = {result["ruleId"]: result for result in run["results"]}
    expected = [{"kind": "external", "justification": "why GK501 is waived"}]
    assert by_id["GK501"]["suppressions"] == expected
    assert "suppressions" not in by_id["GK402"]


def test_sarif_points_at_the_line_of_the_class() -> None:
    """Relative to the sources where the file lies inside; else its whole address."""
    (result, *_) = sarif(mixed(), address=lambda file: f"src/{file}")["runs"][0]["results"]
    place = result["locations"][0]["physicalLocation"]
    assert place["artifactLocation"] == {"uri": "src/rovers.py", "uriBaseId": "%SRCROOT%"}
    assert place["region"] == {"startLine": 12}
    (result, *_) = sarif(mixed(), address=lambda file: f"file:///x/{file}")["runs"][0]["results"]
    (location,) = result["locations"]
    assert location["physicalLocation"]["artifactLocation"] == {"uri": "file:///x/rovers.py"}
    assert location["logicalLocations"][0]["fullyQualifiedName"] == "rovers.Rovers"


def test_sarif_points_at_the_lines_that_do_it() -> None:
    """Of a finding that knows its lines, each is a place, and that of the class is none."""
    document = audit(verdict("GK602", "failed", findings=[finding(lines=["a/x.py:7", "b.py:3"])]))
    (result,) = sarif(document)["runs"][0]["results"]
    places = [each["physicalLocation"] for each in result["locations"]]
    assert [each["artifactLocation"]["uri"] for each in places] == ["a/x.py", "b.py"]
    assert [each["region"]["startLine"] for each in places] == [7, 3]


def test_sarif_without_a_file_names_the_environment() -> None:
    """An environment typed at a prompt has no file to point at."""
    (result, *_) = sarif(audit(verdict("GK402", "failed"), source={}))["runs"][0]["results"]
    (location,) = result["locations"]
    assert "physicalLocation" not in location
    assert location["logicalLocations"][0]["name"] == "rovers.py:make"


def test_sarif_fingerprints_outlive_other_turns() -> None:
    """The same fault at another turn is the same alert to a code host."""
    prints = []
    for turn in (8, 9):
        where = f"rollout/7, turn {turn}, rewards['rover_{turn}']"
        document = audit(verdict("GK402", "failed", findings=[finding(where=where)]))
        prints.append(sarif(document)["runs"][0]["results"][0]["partialFingerprints"])
    assert prints[0] == prints[1]
