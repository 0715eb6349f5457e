"""What checks share that read what the probe `written` saw."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.occasion import Occasion


def written(evidence: Gathered, kind: str) -> Iterator[Occasion]:
    """An occasion for every play in which things of this kind were overwritten."""
    for fact in evidence.facts("written", "written"):
        if fact.where.field == kind:
            seen = fact.value["seen"]
            yield Occasion(
                fact.where, seen is None, "the play goes on as if nothing was written",
                "it goes on the same" if seen is None else seen, proof=fact.proof,
            )  # fmt: skip


def none_of(kind: str, reason: str) -> Callable[[Contract, Gathered], str | None]:
    """Says that nothing of this kind can be written into, where that was looked at."""

    def against(contract: Contract, evidence: Gathered) -> str | None:
        kinds = {fact.where.field for fact in evidence.facts("written", "written")}
        return reason if kinds and kind not in kinds else None

    return against
