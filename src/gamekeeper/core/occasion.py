"""Occasions: every look that a check takes at a promise, good or bad."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gamekeeper.core.proof import Proof
from gamekeeper.core.where import Where


@dataclass(frozen=True, slots=True)
class Occasion:
    """One look at a promise.

    Attributes:
        where: what was looked at.
        ok: whether the promise held.
        expected: what would have been right; a value or words.
        seen: what was there.
        proof: lines that raise while the fault is there; text stands for `Proof(text)`.
        confidence: how sure it is, in (0, 1]; None: as sure as the check in general.
    """

    where: Where
    ok: bool
    expected: Any = None
    seen: Any = None
    proof: Proof | str | None = None
    confidence: float | None = None
