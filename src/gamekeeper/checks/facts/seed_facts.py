"""Facts of the probes of seeds, generators, instances and processes."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class SpecialRefused:
    """Exception that a reset raised at a special seed."""

    text: str


@dataclass(frozen=True, slots=True)
class PlainSeed:
    """A plain seed, beside a special one that fails: does all go well with it."""

    is_fine: bool


@dataclass(frozen=True, slots=True)
class SeededEpisodes:
    """Digests of episodes of seeds in a row, each in a fresh instance where there is one."""

    digests: list[str]


@dataclass(frozen=True, slots=True)
class UnseededEpisodes:
    """Digests of episodes of resets without a seed that follow on one with, in one instance."""

    digests: list[str]


@dataclass(frozen=True, slots=True)
class UnseededAgain:
    """The first episode after a reset without a seed, in two instances that were seeded alike."""

    is_same: bool


@dataclass(frozen=True, slots=True)
class UnseededOpenings:
    """Results of resets without a seed and without a step between.

    Only where all seeded episodes are equal and unseeded ones aren't.
    """

    openings: list[str]


@dataclass(frozen=True, slots=True)
class EpisodeElsewhere:
    """Difference, in words, of an episode with other generator states; None where there is none.

    Only where all episodes are equal.
    """

    difference: str | None


@dataclass(frozen=True, slots=True)
class EpisodeBefore:
    """Seed and actions of an episode that went before, beside a difference; None: the same one."""

    episode: tuple[int | None, tuple[Any, ...]] | None
    times: int = 1


@dataclass(frozen=True, slots=True)
class LaterSeeds:
    """Comparison of later seeds: do they make a difference."""

    in_fresh: bool
    in_used: bool


@dataclass(frozen=True, slots=True)
class UnmovedGenerator:
    """Name of a global generator that nothing moved."""

    generator: str


@dataclass(frozen=True, slots=True)
class MovedGenerator:
    """A global generator that was moved.

    Attributes:
        call: the first that moved it: `make`, `reset` or `step`.
        lines: `file:line` of what moved it, the first ones; empty where they aren't known.
    """

    generator: str
    call: str
    lines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class AskedEntropy:
    """Lines that asked the system for entropy, the first ones, as `file:line`."""

    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class OtherInstance:
    """The other instance, beside a counterfactual that differs."""

    seed: int
    actions: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class HashSeed:
    """The hash seed of the other process, beside a counterfactual that differs."""

    seed: int


@dataclass(frozen=True, slots=True)
class NumberedObjects:
    """An episode in which id() gave other numbers, of an environment that gives one by itself.

    Attributes:
        start: number of the first object, where that made a difference.
        turn: at which it did; None where none did.
    """

    start: int
    turn: int | None


@dataclass(frozen=True, slots=True)
class RosterElsewhere:
    """Order of `agents` here and in a process of another hash seed, where all else is the same.

    The first that differ; of plays whose rosters never do, the last.
    """

    here: tuple[str, ...]
    there: tuple[str, ...]
    hash_seed: int


@dataclass(frozen=True, slots=True)
class SettledElsewhere:
    """New processes with one hash seed, beside an unchanged rerun that differs.

    Settled where they agree, more of them than chance lets agree.
    """

    is_settled: bool
