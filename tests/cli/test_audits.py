import json
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.auditing import audit_process
from gamekeeper.cli import _audit
from gamekeeper.cli._audit import audit_code_of, worst_code
from gamekeeper.reporting.audit_text import audits_text, not_exercised_somewhere
from gamekeeper.rollouts.workers import TaskOutcome
from tests.cli.lines import LINE, document, said
from tests.reporting.audits import audit, verdict
from tests.runs.parts.here import Here, called

PAID = "tests.faults.rewards:PaidAfterEnd"
QUICK = ("--select", "GK402", "--budget", "300")


@pytest.fixture
def _audits_run_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """The environments are ours and do no harm: no process is started for them."""

    def here(task: str, arguments: dict[str, Any], **options: Any) -> TaskOutcome:
        return called(task, arguments)

    monkeypatch.setattr(audit_process, "run_task", here)
    monkeypatch.setattr("gamekeeper.auditing.confirm.TRIES", 1)
    monkeypatch.setattr(_audit, "executor_of", lambda name, workers: Here(1))


@pytest.mark.usefixtures("_audits_run_here")
def test_environments_and_seeds_are_audited_side_by_side(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """One document holds every audit as its own command has it, and the worst exit code counts."""
    line = ["audit", LINE, PAID, "no/such-v0", "--seeds", 2, "--seed", 3, *QUICK]
    code, found = document(capfd, *line, "--workers", 2, "--out", tmp_path)
    assert code == 1
    audits = found["audits"]
    assert [each["seed"] for each in audits] == [3, 4] * 3
    assert [each.get("ok") for each in audits] == [True, True, False, False, None, None]
    assert {each["error"]["kind"] for each in audits[4:]} == {"SpecError"}
    _, alone = document(capfd, "audit", PAID, "--seed", 4, *QUICK)
    for each in (alone, audits[3]):
        for name in ("seconds", "timings", "command"):
            each.pop(name, None)
    assert alone == audits[3]
    assert json.loads((tmp_path / "audits.json").read_text())["audits"][2]["seed"] == 3
    assert (tmp_path / "rewards" / "seed-4" / "GK402.py").exists()
    assert (tmp_path / "junit.xml").read_text().count("<testsuite ") == 4


def test_text_says_in_which_seeds(capfd: pytest.CaptureFixture[str]) -> None:
    """A line for each broken promise with the seeds that showed it, the worst first."""
    code, out, _ = said(capfd, "audit", PAID, "--seeds", 2, *QUICK)
    assert code == 1
    assert "2 seeds, 1 check failed" in out
    assert "GK402  high  all 2 seeds  An agent that has ended is paid nothing more." in out
    assert f"gamekeeper audit {PAID} --seed 0" in out


def test_promise_that_breaks_in_some_seeds_names_them() -> None:
    """What flickers is told apart from what is broken always; what nobody saw is counted."""
    documents = [
        {**audit(verdict("GK402", "failed"), verdict("GK503", "not_exercised")), "seed": 0},
        {**audit(verdict("GK402", "passed"), verdict("GK503", "not_exercised")), "seed": 1},
        {**audit(verdict("GK402", "failed"), verdict("GK503", "passed")), "seed": 2},
    ]
    [(title, manner, findings)] = audits_text(documents, width=80)
    assert "3 seeds, 1 check failed" in title
    assert manner == "bad"
    assert "2 of 3 seeds: 0, 2" in findings
    assert not_exercised_somewhere(documents, width=80) == ""
    assert "GK503" in not_exercised_somewhere(documents[:2], width=80)


@pytest.mark.parametrize(
    ("codes", "worst"), [([], 0), ([0, 0], 0), ([0, 2], 2), ([2, 1, 0], 1), ([1], 1)]
)
def test_broken_is_worse_than_unknown(codes: list[int], worst: int) -> None:
    """The exit code of many is 1 where anything is broken, else 2 where anything can't be told."""
    assert worst == worst_code(codes)


def test_audit_that_could_not_be_made_has_its_code() -> None:
    """An environment that fails exits with 1, wrong use with 2."""
    assert audit_code_of({"error": {"kind": "EnvError"}}) == 1
    assert audit_code_of({"error": {"kind": "SpecError"}}) == 2
