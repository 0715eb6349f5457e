"""A clean environment: beams of one tick all fire, whoever is hit, and rows of agents are swapped.

Its contract declares that the gardeners are interchangeable and their conflicts free of order.
"""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens.gk311_beams_by_dictionary import Beams

BREAKS: tuple[str, ...] = ()


class FairBeams(Beams):
    """Who is hit in a tick is stunned from the next one on."""

    late: dict[str, int]

    def firing_order(self, actions: dict[str, Any]) -> list[str]:
        """The environment's own; it makes no difference here."""
        return list(self.agents)

    def hit_by(self, agent: str) -> list[str]:
        """Stuns after the tick: who fires isn't stopped by who fired before."""
        hit = super().hit_by(agent)
        self.late |= dict.fromkeys(hit, 3)
        return []

    def step(self, actions: dict[str, Any]) -> Any:
        """The beams' effects come once all have fired."""
        self.late = {}
        out = super().step(actions)
        for agent, ticks in self.late.items():
            self.stunned[agent] = ticks
            out[1][agent] -= 1.0
        return ({a: self.observation(a) for a in out[0]}, *out[1:])


def make(**kwargs: Any) -> FairBeams:
    """The environment as it should be."""
    return FairBeams(**kwargs)
