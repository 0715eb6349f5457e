"""Facts of the probes `copies` and `conversion`."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class ChangedView:
    """An observation that changed within a cycle, after some agents had acted."""

    agent: Any
    after: list[Any]


@dataclass(frozen=True, slots=True)
class CopiedEnv:
    """A copy that was made in one way (the field) in mid-episode.

    Attributes:
        refused: what was raised where it lets itself not be copied or stepped.
        copy: what the copy gave otherwise than an episode without a copy, in words.
        original: what the original gave otherwise.
        at: turns after which it was made.
        is_apart: the original was reset with another seed before the copy went on.
    """

    refused: str | None
    copy: str | None
    original: str | None
    at: int
    is_apart: bool = False


@dataclass(frozen=True, slots=True)
class ConvertedEnv:
    """An AEC environment behind PettingZoo's conversion to Parallel.

    Attributes:
        said: whether its metadata say that it is parallelizable.
        failed: what was raised behind the conversion.
        ticks: played so.
    """

    said: bool
    failed: str | None
    ticks: int


@dataclass(frozen=True, slots=True)
class WithinCycle:
    """Observations as an agent's turn came, beside those at the cycle's start; the first change."""

    looks: int
    changed: ChangedView | None
