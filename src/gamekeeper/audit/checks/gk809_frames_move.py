"""GK809."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks._films import filmed, nothing_to_film
from gamekeeper.core.contract import Contract
from gamekeeper.core.fact import Fact
from gamekeeper.core.gathered import Gathered

LEAST_MOVES: Final = 8
"""Turns at which observations changed, before a still picture says anything."""
PROOF: Final = (
    "assert any(not np.array_equal(frames[0], frame) for frame in frames), 'nothing ever moves'"
)


@check(
    "GK809",
    needs=("render",),
    severity=LOW,
    confidence=0.9,
    mend="draw the state that step() has changed",
    applies=nothing_to_film,
)
def frames_move(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Frames follow the game: while observations change over a whole play, the picture does too.

    A video of it shows nothing. Only plays in which somebody's observation changed at eight turns
    or more are looked at; a single other frame in any play is enough.

    Bad:
        def render(self):
            return self.first_frame.copy()

    Good:
        def render(self):
            return self.draw(self.cells)
    """
    films: dict[str, list[tuple[Fact, int]]] = {}
    for fact in evidence.facts("render", "film"):
        shots = [shot["digest"] for shot in fact.value["shots"] if shot["digest"] is not None]
        if len(shots) > LEAST_MOVES and fact.value["moves"] >= LEAST_MOVES:
            films.setdefault(fact.value["mode"], []).append((fact, len(set(shots))))
    for looks in films.values():
        is_ok = any(different > 1 for _, different in looks)
        fact, different = looks[0]
        yield Occasion(
            replace(fact.where, turn=None, field="frames"), is_ok,
            "frames that change as the game moves", f"{different} different frame",
            proof=filmed(evidence.api, fact.value["options"], PROOF),
        )  # fmt: skip
