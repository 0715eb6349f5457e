"""Sound environments of unusual scale and habits: nothing is held against any of them."""

from typing import Any

import pytest

from gamekeeper.auditing.audit import audit_here
from tests.auditing.sound_habits import HABITS
from tests.auditing.sound_scales import SCALES


@pytest.mark.parametrize("build", [pytest.param(SCALES[name], id=name) for name in SCALES])
def test_sound_scale_is_not_accused(build: Any) -> None:
    """Sizes and kinds of numbers, of rosters and of names break no promise."""
    _accused_of_nothing(build)


@pytest.mark.parametrize("build", [pytest.param(HABITS[name], id=name) for name in HABITS])
def test_sound_habit_is_not_accused(build: Any) -> None:
    """What PettingZoo allows breaks no promise, however rare it is."""
    _accused_of_nothing(build)


def _accused_of_nothing(build: Any) -> None:
    # every check, without the measured form, which accuses of nothing
    audit = audit_here(build, budget=1_000, select=("GK",))
    assert [(each.id, each.findings[0].actual) for each in audit.failed] == []
    assert [each.reason for each in audit.verdicts if each.outcome == "error"] == []
