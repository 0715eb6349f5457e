"""Checks of infos, where the matrix doesn't go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.result import AuditResult
from gamekeeper.checks.spaces.info_values import fault_of
from gamekeeper.contract import Contract, InfoField
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders


def audited(make: Any, contract: Contract | None = None) -> AuditResult:
    """The audit by the checks of infos."""
    return audit_here(make, select=("GK24",), budget=200, contract=contract)


def broken(audit: AuditResult) -> list[str]:
    """Ids of what was broken; an error of a check counts too."""
    return [each.id for each in audit.verdicts if each.outcome in ("failed", "error")]


@pytest.mark.parametrize("info", [None, [("battery", 3)]])
def test_infos_that_are_no_dictionaries_are_told(info: Any) -> None:
    """Whatever stands in place of a dictionary is told with its type."""

    class Nonconforming(Rovers):
        def info(self, agent: str) -> Any:
            return info

    audit = audited(Nonconforming)
    assert broken(audit) == ["GK240"]
    assert type(info).__name__ in audit.of("GK240").findings[0].actual


def test_infos_of_turns_are_told() -> None:
    """In an AEC environment it is the info of who is in turn that counts."""

    class Nonconforming(Traders):
        def settle(self) -> None:
            super().settle()
            self.infos = dict.fromkeys(self.agents)

    assert broken(audited(Nonconforming)) == ["GK240"]


@pytest.mark.parametrize(
    ("dtype", "shape", "value", "is_kept"),
    [
        ("int64", [], 3, True),
        ("int64", [], np.int64(3), True),
        ("int32", [], 3, True),  # evidence keeps np.int64 as a plain number
        ("int64", [], 3.5, False),
        ("float32", [2], np.zeros(2, np.float32), True),
        ("float32", [2], np.zeros(2), False),
        ("float32", [2], np.zeros(3, np.float32), False),
        ("float64", [2], (0.5, 1.0), True),
        ("str", [], "here", True),
        ("str", [], 3, False),
        ("json", [], {"a": [1, 2]}, True),
        ("bool", [], True, True),
        ("bool", [], 1, False),
    ],
)
def test_infos_are_compared_with_what_is_declared(
    dtype: str, shape: list[int], value: Any, is_kept: bool
) -> None:
    """Dtype and shape are those of the contract; a plain number has any dtype of its kind."""
    assert (fault_of(InfoField(dtype=dtype, shape=tuple(shape)), value) is None) == is_kept


def test_infos_without_a_declared_field_are_kept() -> None:
    """A field that isn't there this time is no fault, nor is one that nobody declared."""

    class Told(Rovers):
        def info(self, agent: str) -> dict[str, Any]:
            return {"told": np.zeros(2)} if self.time % 2 else {"other": {agent}}

    contract = Contract.from_json({"infos": {"told": {"dtype": "float64", "shape": [2]}}})
    assert broken(audited(Told, contract)) == []


def test_infos_with_varying_keys_are_kept() -> None:
    """Keys may come and go, and values of any plain kind may stand in infos."""

    class Varied(Rovers):
        def info(self, agent: str) -> dict[Any, Any]:
            return {self.time: {"seen": {agent}, 3: None}} if self.time % 2 else {}

    assert broken(audited(Varied)) == []
