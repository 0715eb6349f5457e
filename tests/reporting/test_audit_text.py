import pytest

from gamekeeper.checks.verdict import NO_CASE
from gamekeeper.reporting.audit_text import (
    brief_rows,
    chances_text,
    counts_text,
    errors_text,
    failed_blocks,
    not_exercised_text,
    program_of,
    suspected_text,
    title_text,
    waived_text,
)
from tests.reporting.audits import PROGRAM, audit, finding, mixed, verdict


def test_title_counts_what_the_audit_came_to() -> None:
    """One line: environment, API, and the outcomes, failures last."""
    expected = (
        "rovers.py:make (Parallel): 1 passed, 1 waived, 1 not exercised, 1 not applicable, "
        "1 error, 2 failed (1 high, 1 low)"
    )
    assert expected == title_text(mixed(), width=130)
    assert all(len(line) <= 80 for line in title_text(mixed(), width=80).splitlines())
    assert counts_text(audit()) == "0 passed, 0 failed"


def test_broken_promises_stand_by_severity() -> None:
    """Each severity has a heading; a finding says claim, where, expected, actual and fix."""
    blocks = dict(failed_blocks(mixed(), width=80))
    assert list(blocks) == ["Failed: high severity", "Failed: low severity"]
    high = blocks["Failed: high severity"]
    assert high.splitlines()[0] == "  GK402  Should hold: The promise of GK402."
    for word in ("rollout/7, turn 8", "expected  0.0", "actual    0.5", "30 of 260 cases"):
        assert word in high


def test_thousands_of_cases_have_their_comma() -> None:
    """So they are read at a glance."""
    document = audit(verdict("GK402", "failed", cases=3068, failed=3068))
    assert (
        "3,068 of 3,068 cases" in dict(failed_blocks(document, width=120))["Failed: high severity"]
    )


def test_consequences_stand_after_their_cause_in_a_line_each() -> None:
    """What passes once its cause is held still names the cause and what was held still."""
    cause = {"id": "GK602", "held_still": "global generators seeded"}
    document = audit(
        verdict("GK601", "failed", follows_from=cause, reproduced=None), verdict("GK602", "failed")
    )
    blocks = dict(failed_blocks(document, width=120))
    assert list(blocks) == ["Failed: high severity", "Failed: consequences of these"]
    expected = "Follows from GK602: with global generators seeded, it passes."
    assert blocks["Failed: consequences of these"].endswith(expected)
    assert "GK601" not in blocks["Failed: high severity"]


def test_cause_stands_where_the_worst_of_its_consequences_would() -> None:
    """A medium cause of a high consequence is of high severity."""
    cause = {"id": "GK106", "held_still": "entries deleted"}
    document = audit(
        verdict("GK106", "failed", severity="medium"),
        verdict("GK402", "failed", follows_from=cause, reproduced=None),
    )
    blocks = dict(failed_blocks(document, width=120))
    assert "GK106" in blocks["Failed: high severity"]
    assert "GK402" in blocks["Failed: consequences of these"]


def test_suspected_checks_are_no_failures() -> None:
    """They are counted by themselves, and shown with the reason."""
    document = audit(verdict("GK601", "suspected", reason="its reproducer passes"))
    assert counts_text(document) == "0 passed, 1 suspected, 0 failed"
    assert list(failed_blocks(document, width=80)) == []
    assert "Not confirmed: its reproducer passes." in suspected_text(document, width=120)


def test_findings_after_the_first_are_named() -> None:
    """Where a promise is broken in several fields, the others are told in a line each."""
    found = [finding(), finding(where="rollout/1, turn 2, infos", actual="None")]
    ((_, text),) = failed_blocks(audit(verdict("GK402", "failed", findings=found)), width=80)
    assert "also      rollout/1, turn 2, infos: actual None" in text


def test_uncertain_findings_say_how_sure_they_are() -> None:
    """A confidence below certainty stands beside the number of looks."""
    ((_, text),) = failed_blocks(audit(verdict("GK312", "failed", confidence=0.9)), width=80)
    assert "confidence 0.90" in text


@pytest.mark.parametrize("width", [60, 80, 110])
def test_lines_keep_to_the_width(width: int) -> None:
    """No line of prose is wider than the terminal."""
    long = finding(expected="a value " * 60, actual="x" * 900)
    document = audit(verdict("GK402", "failed", claim="A promise " * 20, findings=[long]))
    ((_, text),) = failed_blocks(document, width=width)
    assert max(map(len, text.splitlines())) <= width


def test_control_signs_are_made_visible() -> None:
    """What an environment puts into a finding can't steer the terminal."""
    document = audit(verdict("GK402", "failed", findings=[finding(actual="\x1b[2J")]))
    ((_, text),) = failed_blocks(document, width=80)
    assert "\x1b" not in text


def test_program_is_that_of_the_worst_finding() -> None:
    """The worst one with a program; none where nothing is broken."""
    no_program = [finding(reproducer="")]
    document = audit(
        verdict("GK821", "failed", severity="low"), verdict("GK101", "failed", findings=no_program)
    )
    assert program_of(document) == ("GK821", PROGRAM)
    assert program_of(audit(verdict("GK101", "passed"))) is None


@pytest.mark.parametrize(("failed", "is_shown"), [(5, True), (4, False)])
def test_program_of_a_suspected_check_is_one_that_fails_everywhere(
    failed: int, is_shown: bool
) -> None:
    """A check that can't be certain has a program that fails in every process; a flaky one none."""
    how = {"failed": failed, "tried": 5, "unchanged_passed": None}
    document = audit(verdict("GK219", "suspected", findings=[finding()], reproduced=how))
    assert (program_of(document) is not None) == is_shown


def test_waivers_are_shown_with_their_reasons() -> None:
    """Waived promises, waivers that nothing needs any more, and those of no check at all."""
    document = audit(
        verdict("GK501", "waived", reason="on purpose"),
        verdict("GK402", "passed", reason="its waiver isn't needed any more (old)"),
        declared={"waivers": {"GK501": "on purpose", "GK402": "old", "GK999": "a slip"}},
    )
    text = waived_text(document, known={"GK501", "GK402"}, width=80)
    assert "Waived: on purpose" in text
    assert "isn't needed any more (old)" in text
    assert "GK999  a check with this id doesn't exist" in text
    assert waived_text(audit(), known=(), width=80) == ""


def test_not_exercised_checks_are_gathered_by_reason() -> None:
    """A reason stands once, behind the ids of its checks."""
    document = audit(
        *(verdict(id, "not_exercised", reason="no episode ended") for id in ("GK1", "GK2"))
    )
    assert not_exercised_text(document, width=80) == (
        "Not exercised (2)\n"
        "  GK1, GK2: no episode ended\n"
        "  gamekeeper explain ID says what a check promises."
    )
    cut = not_exercised_text({**document, "stopped": "no episode ended, in time"}, width=80)
    assert "  2 checks: no episode ended\n" in cut


def test_not_exercised_checks_say_what_they_look_at() -> None:
    """Checks that need the same share a line; other reasons stand apart."""
    reasons = [NO_CASE, *[f"{NO_CASE}: an agent with an action mask"] * 2]
    found = [verdict(f"GK{k}", "not_exercised", reason=text) for k, text in enumerate(reasons)]
    assert not_exercised_text(audit(*found), width=80) == (
        "Not exercised (2), as no episode had\n"
        "  GK1, GK2: an agent with an action mask\n\n"
        "Not exercised (1)\n"
        "  GK0: no episode had what they need\n"
        "  gamekeeper explain ID says what a check promises."
    )


def test_passed_checks_with_few_cases_say_what_they_could_miss() -> None:
    """Those with many cases stay unnamed."""
    document = audit(
        *(verdict(id, "passed", cases=4, could_miss=0.527) for id in ("GK1", "GK2")),
        verdict("GK3", "passed", cases=400, could_miss=0.0075),
    )
    assert chances_text(document, width=120) == (
        "Of those passed, 2 checks had 4 cases or fewer: a fault in 1 case of 10 could have been "
        "missed (--json: cases,\n  could_miss)"
    )


def test_errors_show_the_last_line_of_the_traceback() -> None:
    """What a check raised is told in a line."""
    assert "GK502  NameError: name 'x' is not defined" in errors_text(mixed(), width=80)


def test_brief_rows_count_what_they_leave_out() -> None:
    """The worst ones by id, severity and claim; the rest by id alone."""
    rows = brief_rows(mixed(), most=1)
    assert rows == [
        ("GK402", "high", "Should hold: The promise of GK402."),
        ("", "", "and 1 more: GK821"),
    ]
