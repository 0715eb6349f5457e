"""What checks share that look at twins: an occasion for each that the sham doesn't explain."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.core.canon import shown
from gamekeeper.core.difference import shown_pair
from gamekeeper.core.gathered import Twin
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.proof import Proof

FIELDS: Final = {"reward": "rewards", "action": "actions", "obs": "observations"}


def judged(twin: Twin, expected: str, proof: Proof | None = None) -> Iterator[Occasion]:
    """Whether the twin goes as its base does; nothing where the sham parts from it anywhere.

    A play that isn't the same twice may part from itself earlier or later each time, so that a
    sham which happens to part later than the twin accuses nobody.
    """
    found = twin.divergence
    if twin.noise is not None:
        return
    if found is None:
        yield Occasion(twin.base.at(None), True, expected, "the same", proof=proof)
        return
    name, _, _ = found.field.partition(".")
    where = twin.base.at(found.turn, found.agent, FIELDS.get(name, name))
    recorded, replayed = shown(found.recorded), shown(found.replayed)
    if "\n" in recorded + replayed:  # large arrays: the first element that differs
        recorded, replayed = shown_pair(found.recorded, found.replayed)
    yield Occasion(where, False, f"{expected}: {recorded}", replayed, proof=proof)
