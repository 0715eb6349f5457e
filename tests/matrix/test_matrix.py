"""Every check on every faulty environment: it fails on its own, on no other, sees a clean one."""

import pytest

from gamekeeper.checks.check import checks
from tests.faults import environments
from tests.matrix.audits import CLEAN, NAMES, seen

ONLY_IN_EVIDENCE = {
    ("NumberAndText", "GK608"),  # which takes the agents 1 and "1" for one
    ("OrdersAreObjects", "GK608"),  # which can't hold the actions, nor can a program
    ("LastPaysOut", "GK403"),  # which asks last() twice in a turn, as no program of it does
    ("SpacesDraw", "GK607"),  # whose paper asks for no space, as who plays freely does
}
"""Consequences of what evidence makes of an environment; no program can see them without it."""


@pytest.mark.parametrize("name", NAMES)
def test_environment_fails_its_own_checks(name: str) -> None:
    """A faulty environment fails its own check, perhaps those declared beside, and no other."""
    each, audit = environments()[name], seen(name).audit
    broken = {verdict.id for verdict in audit.failed}
    assert set(each.checks) <= broken
    assert broken <= {*each.checks, *each.also}
    assert [v.reason for v in audit.verdicts if v.outcome == "error"] == []


@pytest.mark.parametrize("id", sorted(checks()))
def test_check_fails_on_a_faulty_environment_and_passes_on_a_clean_one(id: str) -> None:
    """No check is there that can't trip, and none that is green without having looked."""
    assert [name for name in NAMES if id in environments()[name].checks] != []
    assert [name for name in CLEAN if seen(name).audit.of(id).outcome == "passed"] != []


@pytest.mark.parametrize("name", [name for name in NAMES if name not in CLEAN])
def test_program_of_every_finding_raises_while_the_fault_is_there(name: str) -> None:
    """Each program that an audit writes exits with 1 where the fault is there, by its own line."""
    found = seen(name)
    shown = {ran.check for ran in found.programs}
    assert set(environments()[name].checks) <= shown
    judged = [ran for ran in found.programs if (name, ran.check) not in ONLY_IN_EVIDENCE]
    assert [(ran.check, ran.program) for ran in judged if ran.code != 1] == []
    errors = [line for ran in found.programs for line in ran.errors.splitlines()]
    wrong = ("SyntaxError", "NameError", "ImportError", "ModuleNotFoundError")
    assert [line for line in errors if line.startswith(wrong)] == []
