"""An audit that is ended early, by its time or by Ctrl-C, gives what it knows by then."""

import itertools
import time
from typing import Any

import pytest

from gamekeeper.auditing.audit import AuditAttempt
from gamekeeper.auditing.audit_process import AuditInterruptedError, audit
from gamekeeper.cli._audit import audit_code
from gamekeeper.rollouts.workers import TaskOutcome
from tests.auditing.lucky_games import Slow
from tests.auditing.test_confirmation import GAMES, audited


def test_audit_ends_when_its_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """It gives what it knows by then, and what wasn't exercised with the reason."""
    monkeypatch.setattr(Slow, "clock_s", 0.0)
    monkeypatch.setattr(time, "monotonic", lambda: Slow.clock_s)
    found = audited("Slow", seconds=3.0)
    assert Slow.clock_s < 3.1  # without a bound it takes minutes
    assert found.stopped == "the audit's time was over"
    reasons = {each.reason for each in found.verdicts if each.outcome == "not_exercised"}
    assert "the audit's time was over" in reasons
    assert found.counts["passed"] > 0


def test_audit_of_an_environment_that_hangs_ends_when_its_time_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It doesn't wait for a sign of life, says what it knows, and calls nothing a failure."""
    monkeypatch.setattr("gamekeeper.auditing.audit_process.LATE_S", 1.0)
    begun_s = time.monotonic()
    found = audit(f"{GAMES}:Stuck", seconds=1.0, select=("GK21",))
    assert time.monotonic() - begun_s < 60.0  # a sign of life is waited for twice as long
    assert "time was over, and its environment hadn't answered" in found.stopped
    told = {(each.outcome, each.reason) for each in found.verdicts}
    assert told == {("not_exercised", found.stopped)}
    assert audit_code(found.to_json(), strict=False) == 2


def test_interrupted_probes_give_what_they_saw() -> None:
    """Ctrl-C in a probe: the probes before it are judged, and of all others the reason is told."""
    names = itertools.count()

    def interrupt(name: str, place: int, count: int) -> None:
        if next(names) == 20:
            raise KeyboardInterrupt

    attempt = AuditAttempt(beat=_Interrupting(300), keeps_partial=True)
    found = audited("Sound", attempt=attempt)
    assert found.stopped == "the audit was interrupted"
    assert found.counts["passed"] > 0
    assert found.stopped in {each.reason for each in found.verdicts}
    assert found.failed == ()
    with pytest.raises(KeyboardInterrupt):
        audited("Sound", attempt=AuditAttempt(on_probe=interrupt))


class _Interrupting:
    """Raises as Ctrl-C does, at a step."""

    def __init__(self, at: int) -> None:
        self.left = at

    def __call__(self) -> None:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


def test_interrupted_audit_carries_its_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a process of its own: the exception is a KeyboardInterrupt with what was known."""
    result = audited("Sound", "GK214")

    def interrupted(*args: Any, **named: Any) -> Any:
        value = {
            "error": None,
            "audit": {**result.to_json(), "stopped": "the audit was interrupted"},
        }
        return TaskOutcome("interrupted", value, None, None, 0.0)

    monkeypatch.setattr("gamekeeper.auditing.audit_process.run_task", interrupted)
    with pytest.raises(AuditInterruptedError) as raised:
        audit(f"{GAMES}:Sound")
    assert raised.value.result.stopped == "the audit was interrupted"


def test_audit_interrupted_before_its_environment_is_open_names_its_checks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its process answered nothing: the checks that were asked are not exercised, and say why."""
    ended = TaskOutcome("interrupted", None, "interrupted", None, 0.5)
    monkeypatch.setattr("gamekeeper.auditing.audit_process.run_task", lambda *args, **named: ended)
    with pytest.raises(AuditInterruptedError) as raised:
        audit(f"{GAMES}:Sound", select=("GK21",))
    found = raised.value.result
    assert {"not_exercised"} == {each.outcome for each in found.verdicts}
    assert all(each.id.startswith("GK21") for each in found.verdicts)
    assert found.stopped == found.verdicts[0].reason
