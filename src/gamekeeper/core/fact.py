"""Facts: what a probe saw that is no turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gamekeeper.core.proof import Proof
from gamekeeper.core.where import Where


@dataclass(frozen=True, slots=True)
class Fact:
    """What a probe saw that is no turn: an exception, a changed array, a time, a frame.

    Attributes:
        name: what kind of fact, in the probe's own words; checks ask for it by this name.
        where: the play, and as far as there is one the turn, the agent and the field.
        value: plain data, or arrays; a check decides what it means.
        proof: how a reader sees it again, where the probe knows better than the check.
    """

    name: str
    where: Where
    value: Any
    proof: Proof | None = None
