"""Every check on every specimen: it trips on its own, on nothing else, and looks at a clean one."""

import pytest

from gamekeeper.audit.check import checks
from tests.matrix.audits import CLEAN, NAMES, module_of, seen


@pytest.mark.parametrize("name", NAMES)
def test_specimen_breaks_what_it_says(name: str) -> None:
    """A specimen breaks its own check, perhaps those that it declares beside, and no other."""
    module, audit = module_of(name), seen(name).audit
    broken = {verdict.id for verdict in audit.broken}
    assert set(module.BREAKS) <= broken
    assert broken <= {*module.BREAKS, *getattr(module, "ALSO", ())}
    assert [v.reason for v in audit.verdicts if v.outcome == "error"] == []


@pytest.mark.parametrize("id", sorted(checks()))
def test_check_has_a_specimen_and_looks_at_a_clean_one(id: str) -> None:
    """No check is there that can't trip, and none that is green without having looked."""
    assert [name for name in NAMES if id in module_of(name).BREAKS] != []
    assert [name for name in CLEAN if seen(name).audit.of(id).outcome == "kept"] != []


@pytest.mark.parametrize("name", [name for name in NAMES if name not in CLEAN])
def test_snippet_raises_while_the_fault_is_there(name: str) -> None:
    """The first finding's program ends with an error, as the fault is there."""
    found = seen(name)
    assert found.program is not None
    assert found.code == 1, found.program
    assert "SyntaxError" not in found.errors
    assert "NameError" not in found.errors
