"""Every check on every faulty environment: it fails on its own, on no other, sees a clean one."""

import ast
from collections.abc import Iterator

import pytest

from gamekeeper.checks.check import checks
from gamekeeper.checks.verdict import Reproduced, Verdict
from tests.faults import environments
from tests.matrix.audits import CLEAN, NAMES, TRIES, seen


@pytest.mark.parametrize("name", NAMES)
def test_environment_fails_its_own_checks(name: str) -> None:
    """A faulty environment fails its own check, perhaps those declared beside, and no other.

    What is no consequence was shown in every fresh process, and without its trigger in none. What
    a check can't be certain of is suspected. Each assertion of a program says what it saw.
    """
    each, audit = environments()[name], seen(name)
    doubtful = {id for id, check in checks().items() if check.doubt}
    outcomes = [("suspected" if v.id in doubtful else "failed", v) for v in audit.verdicts]
    failed = [verdict for outcome, verdict in outcomes if verdict.outcome == outcome]
    broken = {verdict.id for verdict in failed}
    assert set(each.checks) <= broken
    assert broken <= {*each.checks, *each.also}
    assert [v.reason for v in audit.verdicts if v.outcome == "error"] == []
    causes = [verdict for verdict in failed if verdict.follows_from is None]
    assert (causes != []) == (name not in CLEAN)
    expected = [(each.id, Reproduced(TRIES, TRIES, _passed(each))) for each in causes]
    assert expected == [(each.id, each.reproduced) for each in causes]
    assert [each for verdict in failed for each in _silent(verdict)] == []


def test_every_check_fails_on_a_faulty_environment_and_passes_on_a_clean_one() -> None:
    """No check is there that can't trip, and none that is green without having looked."""
    faulty = {id for each in environments().values() for id in each.checks}
    passed = {each.id for name in CLEAN for each in seen(name).verdicts if each.outcome == "passed"}
    assert set(checks()) == faulty == passed


@pytest.mark.parametrize(
    ("name", "consequence", "cause"),
    [
        ("AllPaid", "GK520", "GK106"),
        ("CellInInfos", "GK621", "GK615"),
        ("CopyLosesAView", "GK703", "GK701"),
        ("EachLookDraws", "GK635", "GK634"),
        ("EachLookDrawsGlobally", "GK635", "GK634"),
        ("FlagsStayUp", "GK523", "GK604"),
        ("InfosOfOneTrader", "GK527", "GK109"),
        ("GeneratorOfTheClass", "GK702", "GK607"),
        ("GeneratorOfTheModule", "GK702", "GK607"),
        ("LevelsAreSeen", "GK620", "GK610"),
        ("NotRestored", "GK103", "GK604"),
        ("OneListForGood", "GK604", "GK102"),
        ("PaidAfterEnd", "GK402", "GK106"),
        ("StateDraws", "GK814", "GK636"),
    ],
)
def test_one_fault_is_one_cause(name: str, consequence: str, cause: str) -> None:
    """What passes once the cause is held still follows from it."""
    follows = seen(name).of(consequence).follows_from
    assert follows is not None
    assert follows.id == cause


def _silent(verdict: Verdict) -> Iterator[str]:
    """Assertions of its programs that would end them without a word."""
    for finding in verdict.findings:
        for node in ast.walk(ast.parse(finding.reproducer or "")):
            if isinstance(node, ast.Assert) and node.msg is None:
                yield f"{verdict.id}: {ast.unparse(node)}"


def _passed(verdict: Verdict) -> bool | None:
    """What there can be to see without the trigger: that it passed, or nothing."""
    return verdict.reproduced.unchanged_passed or None if verdict.reproduced else None
