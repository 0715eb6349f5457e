import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from gamekeeper.auditing import audit_process
from gamekeeper.auditing.audit import BUDGET as BUDGET_OF_THE_ENGINE
from gamekeeper.auditing.audit_process import SILENCE_S as SILENCE_OF_THE_ENGINE
from gamekeeper.auditing.audit_process import audit_task
from gamekeeper.cli._audit import audit_code, sarif_of, shares_of, show_failed
from gamekeeper.cli._screen import Screen
from gamekeeper.cli.audit import BUDGET, SILENCE_S
from gamekeeper.rollouts.workers import TaskOutcome
from tests.cli.lines import LINE, document, said
from tests.reporting.audits import audit, finding, mixed, verdict

REAL = pytest.mark.parametrize("_audits_run_here", [False], indirect=True)
"""For tests in which the audit has a process of its own, as users have it."""
PAID = "tests.faults.rewards:PaidAfterEnd"
QUICK = ("--select", "GK402", "--budget", "1000")


@pytest.fixture(autouse=True)
def _audits_run_here(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The environments of these tests are ours and do no harm: no process is started for them."""
    if not getattr(request, "param", True):
        return

    def here(task: str, arguments: dict[str, Any], **options: Any) -> TaskOutcome:
        value = audit_task(lambda **fields: None, **{**arguments, "prints": None})
        return TaskOutcome("done", value, None, None, 0.0)

    monkeypatch.setattr(audit_process, "run_task", here)
    monkeypatch.setattr("gamekeeper.auditing.confirm.TRIES", 1)


@REAL
def test_broken_promise_is_shown_with_its_program(capfd: pytest.CaptureFixture[str]) -> None:
    """Claim, where, expected, seen, fix, then a program that raises; exit code 1."""
    code, out, _ = said(capfd, "audit", PAID, *QUICK)
    assert code == 1
    lines = out.splitlines()
    assert lines[0] == f"{PAID} (Parallel): 0 passed, 1 failed (1 high)"
    assert "Failed: high severity" in lines
    assert "  GK402  Should hold: An agent that has ended is paid nothing more." in lines
    title = "A program that shows GK402: it passes once that is fixed\n"
    program = out.partition(title)[2].partition("\n  --out")[0]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "AssertionError" in done.stderr


def test_clean_environment_is_quiet(capfd: pytest.CaptureFixture[str]) -> None:
    """What is kept is one line, and the exit code 0."""
    code, out, err = said(capfd, "audit", LINE, *QUICK)
    assert code == 0
    assert out == f"{LINE} (Parallel): 1 passed, 0 failed\n"
    assert "Not exercised" not in err


def test_document_is_the_audit(capfd: pytest.CaptureFixture[str]) -> None:
    """With --json the fields that others read, and the exit code as without."""
    code, found = document(capfd, "audit", PAID, *QUICK, "--seed", "3")
    assert code == 1
    fields = {"environment", "api", "ok", "seconds", "steps", "seed", "verdicts", "measured"}
    assert fields <= found.keys()
    assert (found["api"], found["ok"], found["seed"]) == ("parallel", False, 3)
    (only,) = found["verdicts"]
    assert (only["id"], only["outcome"], only["severity"]) == ("GK402", "failed", "high")
    parts = {"where", "expected", "actual", "fix", "reproducer", "lines"}
    assert only["findings"][0].keys() == parts
    assert found["source"]["class"].endswith("PaidAfterEnd")


def test_files_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """--out takes document, JUnit, SARIF and a program for each finding; they are written anew."""
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        line = ("audit", PAID, *QUICK, "--out", "out")
        code, _, err = said(capfd, *line)
        assert code == 1
    assert "written to out: audit.json, junit.xml, audit.sarif, GK402.py" in err
    assert json.loads(Path("out/audit.json").read_text())["ok"] is False
    assert ElementTree.parse("out/junit.xml").getroot().attrib["failures"] == "1"
    (run,) = json.loads(Path("out/audit.sarif").read_text())["runs"]
    place = run["results"][0]["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"].startswith("file:///")
    assert place["region"]["startLine"] > 1
    assert "SEED" in Path("out/GK402.py").read_text()


def test_folder_that_can_not_be_written_is_told_before_the_audit(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The audit, which may take long, isn't made for nothing."""
    (tmp_path / "file").write_text("kept")
    code, out, err = said(capfd, "audit", PAID, *QUICK, "--out", str(tmp_path / "file"))
    assert (code, out) == (2, "")
    assert "the folder can't be written" in err
    assert "GK402" not in err
    assert (tmp_path / "file").read_text() == "kept"


def test_sarif_names_files_inside_the_folder_from_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """An environment of the project one stands in is named as code hosts know it."""
    (tmp_path / "my envs").mkdir()
    file = tmp_path / "my envs" / "line.py"
    file.write_text(Path(LINE.rpartition(":")[0]).read_text())
    monkeypatch.chdir(tmp_path)
    line = ("audit", "my envs/line.py:make", *QUICK, "--out", "out")
    assert said(capfd, *line)[0] == 0
    case = next(ElementTree.parse("out/junit.xml").getroot().iter("testcase"))
    assert case.attrib["file"] == "my envs/line.py"
    found = audit(verdict("GK402", "failed"), source={"file": str(file), "line": 3})
    result = json.loads(sarif_of(found))["runs"][0]["results"][0]
    place = result["locations"][0]["physicalLocation"]["artifactLocation"]
    assert place == {"uri": "my%20envs/line.py", "uriBaseId": "%SRCROOT%"}


def test_lines_of_files_in_the_folder_are_named_from_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Those elsewhere keep their whole path."""
    monkeypatch.chdir(tmp_path)
    lines = [f"{tmp_path}/envs/rovers.py:7", "/elsewhere/rovers.py:8"]
    found = audit(verdict("GK402", "failed", findings=[finding(lines=lines)]))
    show_failed(Screen(sys.stdout, is_quiet=True), found)
    assert "lines     envs/rovers.py:7, /elsewhere/rovers.py:8" in capsys.readouterr().out


def test_sarif_names_a_class_of_a_file_by_the_files_stem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """No internal name of the module stands in what an audit of a file writes."""
    file = tmp_path / "paid_line.py"
    file.write_text(
        f"from {PAID.partition(':')[0]} import PaidAfterEnd\n\n\n"
        "class Paid(PaidAfterEnd):\n    pass\n"
    )
    monkeypatch.chdir(tmp_path)
    assert said(capfd, "audit", f"{file}:Paid", *QUICK, "--out", "out")[0] == 1
    text = Path("out/audit.sarif").read_text()
    (location,) = json.loads(text)["runs"][0]["results"][0]["locations"]
    assert location["logicalLocations"][0]["fullyQualifiedName"] == "paid_line.Paid"
    assert "_gamekeeper_file" not in text
    assert "_gamekeeper_file" not in Path("out/audit.json").read_text()


def test_waiver_is_shown_with_its_reason(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A waived promise is no failure; a waiver of no check at all is told."""
    contract = tmp_path / "rovers.toml"
    contract.write_text('[waivers]\nGK402 = "paid late on purpose"\nGK000 = "a slip"\n')
    code, out, _ = said(capfd, "audit", PAID, *QUICK, "--contract", contract)
    assert code == 0
    assert "1 waived" in out.splitlines()[0]
    told = " ".join(out.split())
    assert "Waived: paid late on purpose" in told
    assert "GK000 a check with this id doesn't exist" in told


def test_not_exercised_counts_on_stderr_and_strictly(capfd: pytest.CaptureFixture[str]) -> None:
    """What nobody saw is counted on stderr; with --strict the exit code is 2."""
    line = ("audit", "warehouse", "--select", "GK501", "--budget", "40")
    code, _, err = said(capfd, *line)
    assert code == 0
    said_so = "Not exercised (1), as no episode had\n  GK501: an agent that leaves"
    assert said_so in err  # after a word of what is compiled, the first time
    assert said(capfd, *line, "--strict")[0] == 2


@pytest.mark.parametrize(("fail_on", "code"), [("low", 1), ("medium", 1), ("high", 0)])
def test_fail_on_sets_the_least_severity(fail_on: Any, code: int) -> None:
    """Broken promises below it don't fail."""
    found = audit(verdict("GK101", "failed", severity="medium"), verdict("GK102", "passed"))
    assert audit_code(found, fail_on=fail_on, strict=False) == code


@pytest.mark.parametrize(
    ("outcomes", "strict", "code"),
    [
        (["passed", "not_applicable", "waived"], True, 0),
        (["passed", "not_exercised"], False, 0),
        (["passed", "not_exercised"], True, 2),
        (["error"], False, 2),
        (["error", "failed"], False, 1),
    ],
)
def test_exit_code_follows_the_outcomes(outcomes: list[str], strict: bool, code: int) -> None:
    """Broken is 1, what can't be told is 2; a sure fault comes before an unsure check."""
    found = audit(*(verdict(f"GK10{place}", each) for place, each in enumerate(outcomes)))
    assert audit_code(found, strict=strict) == code


def test_checks_that_fail_are_told_as_ours(capfd: pytest.CaptureFixture[str]) -> None:
    """An error of a check is a fault of the check, and asks to be reported."""
    from gamekeeper.cli._audit import say_not_exercised

    say_not_exercised(Screen(sys.stdout, is_quiet=True), mixed())
    err = capfd.readouterr().err
    assert "GK502  NameError" in err
    assert "fault of the check, not of the environment" in err


def test_wrong_use_exits_2(capfd: pytest.CaptureFixture[str]) -> None:
    """No such environment, or no such check: exit code 2 and the reason."""
    code, out, err = said(capfd, "audit", "nothing_here:make", "--budget", "100")
    assert (code, out) == (2, "")
    assert "SpecError" in err
    code, _, err = said(capfd, "audit", LINE, "--select", "GK402,XX")
    assert code == 2
    assert "no check is called 'XX'" in err


@REAL
def test_failing_environment_exits_1(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """An environment that ends its process is named with the probe, not lost."""
    (tmp_path / "dying.py").write_text("import os\ndef make():\n    os._exit(3)\n")
    code, _, err = said(capfd, "audit", f"{tmp_path / 'dying.py'}:make", *QUICK)
    assert code == 1
    assert "exit code 3" in err


def test_defaults_are_those_of_the_engine() -> None:
    """The help says what the engine does."""
    assert (BUDGET, SILENCE_S) == (BUDGET_OF_THE_ENGINE, SILENCE_OF_THE_ENGINE)


def test_shares_are_those_of_the_probes_that_look() -> None:
    """Time left is told by the shares of what will really be played."""
    assert list(shares_of(("GK402",), ())) == ["rollout"]
    assert shares_of((), ()).keys() >= {"rollout"}


def test_explain_tells_of_a_check(capfd: pytest.CaptureFixture[str]) -> None:
    """The promise, the examples, the fix."""
    code, out, _ = said(capfd, "explain", "gk402")
    assert code == 0
    assert out.startswith("GK402  An agent that has ended is paid nothing more.")
    assert "\n  Bad:\n\n      for agent in self.possible_agents:" in out
    code, found = document(capfd, "explain", "GK402", "GK4")
    assert code == 0
    ids = [each["id"] for each in found["checks"]]
    assert ids.count("GK402") == 1
    assert all(id.startswith("GK4") for id in ids)


def test_explain_names_the_nearest_where_there_is_none(capfd: pytest.CaptureFixture[str]) -> None:
    """An unknown id is no traceback: exit code 2 and the nearest ids."""
    code, _, err = said(capfd, "explain", "GK4O2")
    assert code == 2
    assert "GK402" in err


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("checks", "GK402"),
        ("probes", "rollout"),
        ("envs", "gamekeeper/warehouse-v0"),
        ("interventions", "ActionOrder"),
        ("policies", "first-legal"),
        ("openers", "path/to/file.py:factory"),
        ("exporters", "numpy"),
    ],
)
def test_list_names_what_there_is(kind: str, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    """Each kind is listed, as text and as a document."""
    code, out, _ = said(capfd, "list", kind)
    assert code == 0
    assert name in out
    rows = document(capfd, "list", kind)[1][kind]
    assert name in [row.get("id", row["name"]) for row in rows]


def test_list_of_everything_counts_the_checks(capfd: pytest.CaptureFixture[str]) -> None:
    """Without a kind all is listed, and the checks are counted by family."""
    code, out, _ = said(capfd, "list")
    assert code == 0
    assert "`gamekeeper list checks`" in out
    assert set(document(capfd, "list")[1]) == {
        "envs",
        "openers",
        "policies",
        "exporters",
        "interventions",
        "probes",
        "checks",
        "suites",
    }


@REAL
def test_prints_of_the_environment_are_kept_in_a_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """They don't flood the screen: they are counted, and it is said where they are."""
    file = tmp_path / "loud.py"
    file.write_text(
        "from tests.faults.rovers import Rovers\n"
        "class Loud(Rovers):\n"
        "    def step(self, actions):\n"
        "        print('a step')\n"
        "        return super().step(actions)\n"
    )
    _, out, err = said(capfd, "audit", f"{file}:Loud", "--select", "GK401", "--budget", "100")
    assert "a step" not in out + err
    found = re.search(r"printed [\d,]+ bytes, which are in (\S+)", err)
    assert found is not None
    kept = Path(found.group(1))
    assert "a step\n" in kept.read_text()
    kept.unlink()
