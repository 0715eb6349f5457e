"""A dead trader is asked twice before it is removed."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK303",)


class AskedTwice(Traders):
    """The first None step of a trader changes nothing."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Nobody has been asked."""
        super().reset(seed, options)
        self.asked: set[str] = set()

    def _was_dead_step(self, action: Any) -> None:
        """Removes a trader at its second None step."""
        agent = self.agent_selection
        if agent in self.asked or action is not None:
            super()._was_dead_step(action)
            return
        self.asked.add(agent)
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()


def make(**kwargs: Any) -> AskedTwice:
    """The environment with its one fault."""
    return AskedTwice(**kwargs)
