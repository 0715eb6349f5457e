"""What plays in a used instance tell, and the program that shows it. Pure."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.literal import literal
from gamekeeper.audit.played_twice import program
from gamekeeper.core.gathered import Look
from gamekeeper.core.proof import Proof


def is_blind_later(look: Look) -> bool:
    """Whether seeds make a difference in a fresh instance, and none in a used one."""
    return any(fact.name == "later seeds" and fact.value == (True, False) for fact in look.facts)


def used_beside_fresh(api: str, before: Any, tells: frozenset[str]) -> Proof:
    """Plays in a used instance and in a fresh one.

    Args:
        before: seed and actions of the episode that goes before; None: of the play itself.
    """
    used = ["used = make()", "play(used)"]
    if before is not None:
        seed, actions = before
        turns = [dict(a) if api == "parallel" else next(iter(a.values()), None) for a in actions]
        used = [
            "used = make()",
            f"used.reset(seed={seed!r})",
            "for actions in [",
            *(f"    {literal(turn)}," for turn in turns),
            "]:",
            "    used.step(actions)",
        ]
    return program(api, *used, "assert play(used) == play(make())", tells=tells)
