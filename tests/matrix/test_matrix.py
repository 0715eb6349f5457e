"""Every check on every faulty environment: it fails on its own, on no other, sees a clean one."""

import pytest

from gamekeeper.checks.check import checks
from gamekeeper.checks.verdict import Reproduced, Verdict
from tests.faults import environments
from tests.matrix.audits import CLEAN, NAMES, TRIES, seen


@pytest.mark.parametrize("name", NAMES)
def test_environment_fails_its_own_checks(name: str) -> None:
    """A faulty environment fails its own check, perhaps those declared beside, and no other."""
    each, audit = environments()[name], seen(name)
    broken = {verdict.id for verdict in audit.failed}
    assert set(each.checks) <= broken
    assert broken <= {*each.checks, *each.also}
    assert [v.reason for v in audit.verdicts if v.outcome == "error"] == []


@pytest.mark.parametrize("id", sorted(checks()))
def test_check_fails_on_a_faulty_environment_and_passes_on_a_clean_one(id: str) -> None:
    """No check is there that can't trip, and none that is green without having looked."""
    assert [name for name in NAMES if id in environments()[name].checks] != []
    assert [name for name in CLEAN if seen(name).of(id).outcome == "passed"] != []


@pytest.mark.parametrize("name", [name for name in NAMES if name not in CLEAN])
def test_reproducer_of_every_failed_check_fails_in_every_fresh_process(name: str) -> None:
    """A failed check was shown in every fresh process, and without its trigger in none."""
    failed = [each for each in seen(name).failed if each.follows_from is None]
    assert failed != []
    expected = [(each.id, Reproduced(TRIES, TRIES, _passed(each))) for each in failed]
    assert expected == [(each.id, each.reproduced) for each in failed]


def _passed(verdict: Verdict) -> bool | None:
    """What there can be to see without the trigger: that it passed, or nothing."""
    return verdict.reproduced.unchanged_passed or None if verdict.reproduced else None
