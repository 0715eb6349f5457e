"""What checks share that read what the probe `handed_over` saw."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from gamekeeper.core.canon import shown
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.proof import Proof


def handed(evidence: Gathered, name: str, proof: Proof) -> Iterator[Occasion]:
    """An occasion for every look at what was handed over."""
    for fact in evidence.facts("handed_over", name):
        changed = fact.value["changed"]
        for _ in range(fact.value["looks"] - (changed is not None)):
            yield Occasion(fact.where, True)
        if changed is not None:
            yield Occasion(
                fact.where, False, shown(changed["before"]), shown(changed["after"]), proof=proof
            )


def nothing_handed(name: str, reason: str) -> Callable[[Contract, Gathered], str | None]:
    """Says that nothing of the kind was handed over."""

    def against(contract: Contract, evidence: Gathered) -> str | None:
        was_played = any(True for _ in evidence.facts("handed_over"))
        return reason if was_played and not any(evidence.facts("handed_over", name)) else None

    return against
