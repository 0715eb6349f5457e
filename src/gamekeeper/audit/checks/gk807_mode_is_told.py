"""GK807."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks._films import nothing_to_film
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK807",
    needs=("render",),
    severity=LOW,
    mend="self.render_mode = render_mode",
    applies=nothing_to_film,
)
def mode_is_told(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """env.render_mode is the mode that was asked for.

    Wrappers and recorders read it to know what render() returns.

    Bad:
        def __init__(self, render_mode=None):
            self.mode = render_mode

    Good:
        def __init__(self, render_mode=None):
            self.render_mode = render_mode
    """
    for fact in evidence.facts("render", "mode"):
        seen = fact.value
        if seen["taken"] and seen["failed"] is None:
            mode = seen["mode"]
            proof = Proof(
                f"mode = getattr(make(), 'render_mode', None)\nassert mode == {mode!r}, mode",
                plays=False,
                options=seen["options"],
            )
            yield Occasion(fact.where, seen["shown"] == mode, mode, seen["shown"], proof=proof)
