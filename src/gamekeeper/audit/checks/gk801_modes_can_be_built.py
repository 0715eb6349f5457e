"""GK801."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._films import nothing_to_film
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK801",
    needs=("render",),
    severity=MEDIUM,
    mend="build the environment in every mode of metadata['render_modes'], or take out those that "
    "it doesn't have",
    applies=nothing_to_film,
)
def modes_can_be_built(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every render mode that the metadata declares can be built.

    Readers choose a mode from `metadata["render_modes"]`; tools that record videos do so unasked.
    The mode "human" is never tried, as it needs a screen; neither is one whose screen or package
    is missing here.

    Bad:
        metadata = {"render_modes": ["rgb_array", "ansi"]}

        def __init__(self, render_mode=None):
            assert render_mode in (None, "rgb_array")

    Good:
        metadata = {"render_modes": ["rgb_array"]}
    """
    for fact in evidence.facts("render", "mode"):
        seen = fact.value
        if seen["taken"] and not seen["is_missing"]:
            failed = seen["failed"]
            yield Occasion(
                fact.where, failed is None, f"an environment in mode {seen['mode']!r}",
                failed or "an environment",
                proof=Proof("make()", plays=False, options=seen["options"]),
            )  # fmt: skip
