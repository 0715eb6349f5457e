"""Every check on every specimen: it trips on its own, on nothing else, and looks at a clean one."""

import importlib
import pkgutil
import subprocess
import sys
from functools import cache
from typing import Any

import pytest

from gamekeeper.audit import specimens
from gamekeeper.audit.audit import audit_here
from gamekeeper.audit.check import checks
from gamekeeper.audit.result import Audit
from gamekeeper.core.contract import Contract

BUDGET = 4_000
NAMES = [
    info.name for info in pkgutil.iter_modules(specimens.__path__) if not info.name.startswith("_")
]
CLEAN = [name for name in NAMES if name.startswith("clean_")]


def module_of(name: str) -> Any:
    """The specimen's module."""
    return importlib.import_module(f"{specimens.__name__}.{name}")


@cache
def audited(name: str) -> Audit:
    """The audit of a specimen under the contract that its module declares."""
    module = module_of(name)
    contract = getattr(module, "CONTRACT", None)
    return audit_here(
        f"{module.__name__}:make",
        contract=None if contract is None else Contract.from_json(contract),
        budget=BUDGET,
    )


@pytest.mark.parametrize("name", NAMES)
def test_specimen_breaks_what_it_says(name: str) -> None:
    """A specimen breaks its own check, perhaps those that it declares beside, and no other."""
    module = module_of(name)
    broken = {verdict.id for verdict in audited(name).broken}
    assert set(module.BREAKS) <= broken
    assert broken <= {*module.BREAKS, *getattr(module, "ALSO", ())}
    assert [v.reason for v in audited(name).verdicts if v.outcome == "error"] == []


@pytest.mark.parametrize("id", sorted(checks()))
def test_check_has_a_specimen_and_looks_at_a_clean_one(id: str) -> None:
    """No check is there that can't trip, and none that is green without having looked."""
    assert [name for name in NAMES if id in module_of(name).BREAKS] != []
    assert [name for name in CLEAN if audited(name).of(id).outcome == "kept"] != []


@pytest.mark.parametrize("name", [name for name in NAMES if name not in CLEAN])
def test_snippet_raises_while_the_fault_is_there(name: str) -> None:
    """The first finding's program ends with an error, as the fault is there."""
    verdict = next(v for v in audited(name).broken if v.id in module_of(name).BREAKS)
    program = verdict.findings[0].reproduce
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 1, program
    assert "SyntaxError" not in done.stderr
    assert "NameError" not in done.stderr
