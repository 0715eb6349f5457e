"""What a game puts its rows on: the protocol of recorders and of evidence in memory."""

from __future__ import annotations

from typing import Any, Protocol

from gamekeeper.core.layout import Layout
from gamekeeper.core.tape import Tape
from gamekeeper.game.capture.ring import Rings


class Sink(Protocol):
    """Takes what a game puts on the tape."""

    tape: Tape
    layout: Layout
    rings: Rings | None

    def keep_up(self) -> None:
        """Called every few turns and at an episode's end; may wait until the tape is shorter."""

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Takes one rendered frame."""
