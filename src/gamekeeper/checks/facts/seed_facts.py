"""Facts of the probes of seeds, generators, instances and processes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class SpecialRefused:
    """A special seed that a reset refused.

    Attributes:
        text: what it raised.
    """

    text: str


@dataclass(frozen=True, slots=True)
class PlainSeed:
    """A plain seed, beside a special one that fails.

    Attributes:
        is_fine: whether all goes well with it.
    """

    is_fine: bool


@dataclass(frozen=True, slots=True)
class SeededPlays:
    """Plays of seeds in a row, each in a fresh instance where there is one.

    Attributes:
        digests: of the plays.
    """

    digests: list[str]


@dataclass(frozen=True, slots=True)
class UnseededPlays:
    """Plays of resets without a seed that follow on one with, in one instance.

    Attributes:
        digests: of the plays.
    """

    digests: list[str]


@dataclass(frozen=True, slots=True)
class UnseededOpenings:
    """Resets without a seed and without a step between.

    Only where all seeded plays are equal and unseeded ones aren't.

    Attributes:
        openings: what they gave.
    """

    openings: list[str]


@dataclass(frozen=True, slots=True)
class PlayElsewhere:
    """A play whose generators stand elsewhere; only where all plays are equal.

    Attributes:
        difference: how it goes, in words; None where it is the same.
    """

    difference: str | None


@dataclass(frozen=True, slots=True)
class EpisodeBefore:
    """The episode that went before, beside a counterfactual that differs.

    Attributes:
        episode: its seed and actions; None: the same one.
        times: how often it was played.
    """

    episode: tuple[int | None, tuple[Any, ...]] | None
    times: int = 1


@dataclass(frozen=True, slots=True)
class LaterSeeds:
    """Comparison of later seeds: do they make a difference.

    Attributes:
        in_fresh: in a fresh instance.
        in_used: in a used one.
    """

    in_fresh: bool
    in_used: bool


@dataclass(frozen=True, slots=True)
class UnmovedGenerator:
    """A global generator that nothing moved.

    Attributes:
        generator: its name.
    """

    generator: str


@dataclass(frozen=True, slots=True)
class MovedGenerator:
    """A global generator that was moved.

    Attributes:
        generator: its name.
        call: the first that moved it: `make`, `reset` or `step`.
    """

    generator: str
    call: str


@dataclass(frozen=True, slots=True)
class OtherInstance:
    """The other instance, beside a counterfactual that differs.

    Attributes:
        seed: of its reset.
        actions: of its play.
    """

    seed: int
    actions: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class HashSeed:
    """The hash seed of the other process, beside a counterfactual that differs.

    Attributes:
        seed: the number.
    """

    seed: int


@dataclass(frozen=True, slots=True)
class SettledElsewhere:
    """New processes with one hash seed, beside an unchanged rerun that differs.

    Attributes:
        is_settled: whether they agree, more of them than chance lets agree.
    """

    is_settled: bool
