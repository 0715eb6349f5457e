"""Facts of the probe `render`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame of a film.

    Attributes:
        turn: at which it was taken.
        over: whether the episode was over.
        failed: what was raised.
        is_missing: whether a screen or a package is missing.
        kind: the type of the frame.
        frames: dtype and shape of each of its arrays.
        digest: of the frame.
    """

    turn: int
    over: bool
    failed: str | None
    is_missing: bool
    kind: str
    frames: list[list[Any]]
    digest: str | None


@dataclass(frozen=True, slots=True)
class BuiltMode:
    """Attempt to build a render mode.

    Attributes:
        mode: its name.
        taken: whether the factory takes the argument.
        is_own: whether it is the mode in use.
        options: for the factory.
        failed: what building it raised.
        is_missing: whether a screen or a package is missing.
        shown: what `env.render_mode` says.
    """

    mode: str
    taken: bool
    is_own: bool
    options: dict[str, Any]
    failed: str | None
    is_missing: bool
    shown: str | None


@dataclass(frozen=True, slots=True)
class FilmedPlay:
    """A filmed play.

    Attributes:
        mode: the render mode.
        options: for the factory.
        moves: turns at which an agent's observation changed.
        shots: by turn.
    """

    mode: str
    options: dict[str, Any]
    moves: int
    shots: list[Shot]


@dataclass(frozen=True, slots=True)
class ChangedFrames:
    """Frames that are no longer what they were when they were handed out.

    Attributes:
        mode: the render mode.
        options: for the factory.
        turns: of the frames that changed.
        count: of the frames that were kept.
    """

    mode: str
    options: dict[str, Any]
    turns: list[int]
    count: int


@dataclass(frozen=True, slots=True)
class WrittenFrames:
    """Frames after the one before was written into.

    Attributes:
        mode: the render mode.
        options: for the factory.
        turns: of the frames that were others.
        count: of all.
    """

    mode: str
    options: dict[str, Any]
    turns: list[int]
    count: int


@dataclass(frozen=True, slots=True)
class FirstFrame:
    """The first frame that an instance was asked for.

    Attributes:
        mode: the render mode.
        options: for the factory.
        turn: at which it was asked for.
        digest: of the frame.
    """

    mode: str
    options: dict[str, Any]
    turn: int
    digest: str | None


@dataclass(frozen=True, slots=True)
class SecondFrame:
    """The frame after a second reset with the same seed, where plays repeat.

    Attributes:
        mode: the render mode.
        options: for the factory.
        digest: of the frame.
    """

    mode: str
    options: dict[str, Any]
    digest: str | None
