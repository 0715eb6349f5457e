"""Whether a game was seen to draw at random. Pure."""

from __future__ import annotations

from gamekeeper.audit.played_twice import settled_by_seed
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


def ignores_seeds(evidence: Gathered) -> bool:
    """Whether all seeds gave one play, and resets without a seed several openings."""
    for look in evidence.looks.get("unseeded", ()):
        facts = {fact.name: fact.value for fact in look.facts}
        if len(set(facts["seeded"])) == 1 and len(set(facts.get("openings", ()))) > 1:
            return True
    return False


def draws_nothing(contract: Contract, evidence: Gathered) -> str | None:
    """Why there is nothing to judge where plays never differ, with or without a seed."""
    against = settled_by_seed(contract, evidence)
    if against is not None:
        return against
    if any(fact.value for fact in evidence.facts("unseeded", "elsewhere")):
        return None
    found = {name: list(evidence.facts("unseeded", name)) for name in ("seeded", "unseeded")}
    if found["seeded"] and all(len(set(f.value)) == 1 for each in found.values() for f in each):
        return "no seed and no reset without one led to another play: nothing was drawn"
    return None
