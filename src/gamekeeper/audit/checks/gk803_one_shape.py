"""GK803."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._films import filmed, nothing_to_film
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = "shapes = {np.shape(frame) for frame in frames}\nassert len(shapes) == 1, shapes"


@check(
    "GK803",
    needs=("render",),
    severity=MEDIUM,
    mend="draw on a canvas of one size, whoever is still alive",
    applies=nothing_to_film,
)
def frames_keep_their_shape(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """All frames of a play have one shape.

    A video has one size: writers refuse the first frame of another, or the whole video is lost.

    Bad:
        frame = np.zeros((8, 8 * len(self.agents), 3), np.uint8)

    Good:
        frame = np.zeros((8, 8 * len(self.possible_agents), 3), np.uint8)
    """
    for fact in evidence.facts("render", "film"):
        if fact.value["mode"] != "rgb_array":
            continue
        proof = filmed(evidence.api, fact.value["options"], PROOF)
        pictures = [shot for shot in fact.value["shots"] if len(shot["frames"]) == 1]
        for shot in pictures[1:]:
            first, shape = pictures[0]["frames"][0][1], shot["frames"][0][1]
            yield Occasion(
                replace(fact.where, turn=shot["turn"]), shape == first, first, shape, proof=proof
            )
