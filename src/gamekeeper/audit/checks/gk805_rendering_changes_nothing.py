"""GK805."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._films import nothing_to_film, told
from gamekeeper.audit.checks._twins import judged
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LINES = (
    "assert course(make(), film=True) == course(make(), film=False), 'render() changed the game'"
)


@check(
    "GK805",
    needs=("render",),
    severity=HIGH,
    mend="draw from the game's state without changing it; what is random in a picture needs a "
    "generator of its own",
    applies=nothing_to_film,
)
def rendering_changes_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """render() doesn't change the game, nor draw from its generator: a filmed play goes like an unfilmed one.

    Otherwise a recorded run can't be compared with one that was trained without a camera. The same
    actions from the same seed are played in the same mode, rendered at every turn and never.

    Bad:
        def render(self):
            shade = self.rng.integers(256)

    Good:
        def render(self):
            shade = self.picture_rng.integers(256)
    """  # noqa: E501  # the claim is one line
    for twin in evidence.twins("render"):
        if twin.change["change"] == "Rendered":
            proof = Proof(
                told(evidence.api) + LINES, plays=False, options=_options(evidence, twin.change)
            )
            yield from judged(twin, "the play without a camera", proof)


def _options(evidence: Gathered, change: object) -> dict[str, str]:
    mode = change["mode"]  # type: ignore[index]  # plain data of a change
    for fact in evidence.facts("render", "mode"):
        if fact.value["mode"] == mode:
            return dict(fact.value["options"])
    return {"render_mode": mode}
