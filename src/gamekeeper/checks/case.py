"""Cases: the places where a check looks at a promise, good or bad, and proofs of the bad ones."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from gamekeeper.checks.verdict import Severity
from gamekeeper.episodes.where import Where


@dataclass(frozen=True, slots=True)
class Reproducer:
    """Lines of Python that raise while the fault is there, and pass once it is fixed.

    They stand after an episode: `env` is where it has led, and with a Parallel environment
    `observations`, `rewards`, `terminations`, `truncations`, `infos` are what the last call gave
    (after no step at all only `observations` and `infos`). `make()` builds another instance, `SEED`
    and `ACTIONS` are the episode, `np` is numpy.

    Attributes:
        lines: Python.
        plays: False: nothing is played before; the lines do it all, from `make()` on.
        imports: modules that the lines need, beside numpy.
        options: what `make()` hands to the factory, beside the user's own arguments; `plain()`
            is then an instance without them.
        compares: two episodes are compared, one of them with a trigger (an extra call, another
            order, a write): the same episode twice, without the trigger, must be equal.
        unchanged: lines that take the place of `lines` to see that; None: the episode twice. Empty:
            there is no trigger, the episodes differ by themselves.
    """

    lines: str
    plays: bool = True
    imports: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    compares: bool = False
    unchanged: str | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """One look at a promise.

    Attributes:
        where: what was looked at.
        ok: whether the promise held.
        expected: what would have been right; a value or words.
        actual: what was there.
        proof: lines that raise while the fault is there; text stands for `Reproducer(text)`.
        confidence: how sure it is, in (0, 1]; None: as sure as the check in general.
        severity: how bad it is; None: as bad as the check in general.
        lines: lines of the environment that do it, as `file:line`, where they are known.
        fix: how it is repaired; None: as the check says.
    """

    where: Where
    ok: bool
    expected: Any = None
    actual: Any = None
    proof: Reproducer | str | None = None
    confidence: float | None = None
    severity: Severity | None = None
    lines: tuple[str, ...] = ()
    fix: str | None = None


Cases: TypeAlias = Iterator[Case]
