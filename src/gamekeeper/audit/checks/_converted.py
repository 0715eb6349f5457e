"""What checks share that read what the probe `conversion` saw."""

from __future__ import annotations

from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


def not_said(contract: Contract, evidence: Gathered) -> str | None:
    """Why there is nothing to judge: it doesn't say that it is parallelizable."""
    said = [fact.value["said"] for fact in evidence.facts("conversion", "converted")]
    return "its metadata don't say that it is parallelizable" if said and not any(said) else None
