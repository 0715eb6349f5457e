"""Places in episodes: number, turn, agent, field."""

from dataclasses import dataclass
from typing import Final

PAID_BY: Final = frozenset({"rewards", "actions", "order", "raised", "terms"})
"""Fields that stand at the turn whose step made them; all others are given at its start."""


@dataclass(frozen=True, slots=True)
class Where:
    """A place in an episode, as findings and errors name it.

    Attributes:
        probe: name of the probe that ran the episode; empty for a recorded run.
        play: number of the episode in its probe or in its run.
        turn: the turn; None for the episode as a whole.
        agent: the agent; None where no one agent is meant.
        field: `observations`, `rewards`, `cumulative_reward`, `terminations`, `truncations`,
            `infos`, `agents`, `state`, ...
    """

    probe: str = ""
    play: int = 0
    turn: int | None = None
    agent: str | None = None
    field: str = ""

    @property
    def env_steps(self) -> int | None:
        """Number of steps after which it can be seen; None: all of them."""
        return None if self.turn is None else self.turn + (self.field in PAID_BY)

    def __str__(self) -> str:
        start = f"episode {self.play}" + (f" of probe {self.probe}" if self.probe else "")
        turn = None if self.turn is None else f"turn {self.turn}"
        name, bracket, inside = self.field.partition("[")  # infos['x'] of one: infos[agent]['x']
        key = self.field if self.agent is None else f"{name}[{self.agent!r}]{bracket}{inside}"
        return ", ".join(part for part in (start, turn, key) if part)
