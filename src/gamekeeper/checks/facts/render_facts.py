"""Facts of the probe `render`."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame of a film.

    Attributes:
        is_missing: whether a screen or a package is missing.
        frames: dtype and shape of each of its arrays.
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
        taken: whether the factory takes the argument.
        failed: what building it raised.
        is_missing: whether a screen or a package is missing.
        shown: what `env.render_mode` says.
    """

    mode: str
    taken: bool
    options: dict[str, Any]
    failed: str | None
    is_missing: bool
    shown: str | None


@dataclass(frozen=True, slots=True)
class RenderedMode:
    """An instance in a render mode."""

    mode: str
    options: dict[str, Any]


@dataclass(frozen=True, slots=True)
class RenderedEpisode(RenderedMode):
    """A filmed episode, and the number of turns at which an agent's observation changed."""

    moves: int
    shots: list[Shot]

    def shown(self, turn: int) -> str | None:
        """Digest of the frame at this turn."""
        return next((shot.digest for shot in self.shots if shot.turn == turn), None)

    def since(self, turn: int) -> int:
        """The first of the turns in a row, this one the last, at which the film shows the same."""
        while turn and self.shown(turn - 1) == self.shown(turn):
            turn -= 1
        return turn


@dataclass(frozen=True, slots=True)
class ChangedFrames(RenderedMode):
    """Turns of frames that aren't what they were when handed out, of how many that were kept."""

    turns: list[int]
    count: int


class WrittenFrames(ChangedFrames):
    """Turns of frames that differ as the one before was written into, of how many."""


@dataclass(frozen=True, slots=True)
class FirstFrame(RenderedMode):
    """Digest of the first frame that an instance was asked for, and the turn of that."""

    turn: int
    digest: str | None


@dataclass(frozen=True, slots=True)
class SecondFrame(RenderedMode):
    """Digest of the frame after a second reset with the same seed, where plays repeat."""

    digest: str | None
