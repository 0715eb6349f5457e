"""The game form as it was seen, beside what is declared. Pure."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROBES: Final[tuple[str, ...]] = ("rollout",)
"""Probes whose looks it reads."""


def measured(contract: Contract, evidence: Gathered) -> dict[str, Any]:
    """What was measured, by the names of the audit's document."""
    return {}
