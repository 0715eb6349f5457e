"""GK806."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._films import nothing_to_film, told
from gamekeeper.audit.checks._twins import judged
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LINES = (
    "assert course(make(), film=False) == course(plain(), film=False), 'the mode is another game'"
)


@check(
    "GK806",
    needs=("render",),
    severity=HIGH,
    mend="let render_mode decide about pictures alone",
    applies=nothing_to_film,
)
def mode_changes_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The render mode doesn't change the game: equal seeds and actions give the same play in every mode.

    A policy that was trained without pictures would otherwise be shown, and judged, in another game.

    Bad:
        if self.render_mode is not None:
            self.rng = np.random.default_rng(0)   # nicer videos

    Good:
        self.rng = np.random.default_rng(seed)
    """  # noqa: E501  # the claim is one line
    for twin in evidence.twins("render"):
        if twin.change["change"] == "RenderMode":
            options = {"render_mode": twin.change["mode"]}
            proof = Proof(told(evidence.api) + LINES, plays=False, options=options)
            yield from judged(twin, "the play in the usual mode", proof)
