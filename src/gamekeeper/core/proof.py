"""Proofs: the last lines of a snippet, which raise as long as a fault is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Proof:
    """Lines of Python that raise while the fault is there, and pass once it is mended.

    They stand after a play: `env` is where it has led, and with a Parallel environment
    `observations`, `rewards`, `terminations`, `truncations`, `infos` are what the last call gave
    (after no step at all only `observations` and `infos`). `make()` builds another instance, `SEED`
    and `ACTIONS` are the play, `np` is numpy.

    Attributes:
        lines: Python.
        plays: False: nothing is played before; the lines do it all, from `make()` on.
        imports: modules that the lines need, beside numpy.
        options: what `make()` hands to the factory, beside the user's own arguments; `plain()`
            is then an instance without them.
    """

    lines: str
    plays: bool = True
    imports: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
