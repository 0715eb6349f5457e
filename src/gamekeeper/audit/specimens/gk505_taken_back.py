"""When a pair has won both players terminate, and then the one who is left doesn't any more."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS = ("GK505",)


class TakenBack(Tokens):
    """Flags are worked out anew while the dead wait for their turn."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Nobody was left alone yet."""
        super().reset(seed, options)
        self.was_alone = False

    def step(self, action: Any) -> None:
        """Who is left alone may take one more cell, if there is one."""
        if self.was_alone and not self.terminations[self.agent_selection]:
            self._cumulative_rewards[self.agent_selection] = 0.0
            self._clear_rewards()
            self.terminations[self.agent_selection] = True
            return
        super().step(action)
        if len(self.agents) == 1 and not self.was_alone and self.legal().any():
            self.was_alone = True
            self.terminations[self.agents[0]] = False


def make(**kwargs: Any) -> TakenBack:
    """The environment with its one fault."""
    return TakenBack(**kwargs)
