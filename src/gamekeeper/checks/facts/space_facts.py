"""Facts of the probe `spaces`."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class AskedSpace:
    """A space that was asked for twice in a row.

    Attributes:
        which: `observation` or `action`.
        when: `before reset`, `live`, `after it left`, `after the episode`, `after another reset`.
        is_same: whether both are one object.
    """

    which: str
    when: str
    space: Any
    failed: str | None
    type: str
    is_same: bool


@dataclass(frozen=True, slots=True)
class ChangedSpace:
    """A space beside what it was first, at a time as in `AskedSpace`."""

    when: str
    was: str
    now: str
    is_same: bool


@dataclass(frozen=True, slots=True)
class SpaceFaults:
    """Faults of a space's making, in words."""

    faults: list[str]


@dataclass(frozen=True, slots=True)
class SpaceEntry:
    """An entry of `observation_spaces` or `action_spaces` beside the method's space, as texts."""

    dictionary: str
    method: str
    is_same: bool


@dataclass(frozen=True, slots=True)
class OthersView:
    """Observation by `observe` of a live agent that isn't in turn.

    Attributes:
        misfits: kind, path, expected, seen and test of each.
        size: how many numbers it holds, those of an action mask left out.
        differs: places of the numbers that aren't those of the agent in turn.
        moved: places in which the agent in turn observes another number than the one before it.
    """

    failed: str | None
    misfits: list[list[Any]]
    size: int = 0
    differs: frozenset[int] = frozenset()
    moved: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class PickledInfo:
    """Reason why a live agent's info can't be pickled; None where it can."""

    unpicklable: str | None


@dataclass(frozen=True, slots=True)
class NumpyFlag:
    """The first flag of an episode that is a bool of NumPy's; the field names the dictionary."""
