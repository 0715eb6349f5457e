"""Places in traces: which play, which turn, whose, which field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

PAID_BY: Final = frozenset({"rewards", "actions", "order", "raised", "terms"})
"""Fields that stand at the turn whose crossing made them; all others are given at its start."""


@dataclass(frozen=True, slots=True)
class Where:
    """A place in a trace, as findings and errors name it.

    Attributes:
        probe: which probe played; empty for a recorded run.
        play: number of the play in its probe, or of the episode in its run.
        turn: the turn; None for the play as a whole.
        agent: whose; None where no one agent is meant.
        field: `observations`, `rewards`, `received`, `terminations`, `truncations`, `infos`,
            `agents`, `state`, ...
    """

    probe: str = ""
    play: int = 0
    turn: int | None = None
    agent: str | None = None
    field: str = ""

    @property
    def crossings(self) -> int | None:
        """How many steps must have been made until it can be seen; None: all of them."""
        if self.turn is None:
            return None
        return self.turn + (self.field in PAID_BY)

    def __str__(self) -> str:
        start = f"{self.probe}/{self.play}" if self.probe else f"episode {self.play}"
        turn = None if self.turn is None else f"turn {self.turn}"
        key = self.field if self.agent is None else f"{self.field}[{self.agent!r}]"
        return ", ".join(part for part in (start, turn, key) if part)
