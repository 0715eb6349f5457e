"""The mask is from before the other player moved."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS = ("GK235",)


class StaleMask(Tokens):
    """Made when the last own turn was over."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Both begin with the first mask."""
        super().reset(seed, options)
        self.kept = dict.fromkeys(self.agents, self.legal())

    def step(self, action: Any) -> None:
        """Keeps the mask for the own next turn."""
        agent = self.agent_selection
        super().step(action)
        self.kept[agent] = self.legal()

    def observe(self, agent: str) -> dict[str, Any]:
        """The mask that was kept."""
        seen = super().observe(agent)
        return {**seen, "action_mask": seen["action_mask"] | self.kept[agent]}


def make(**kwargs: Any) -> StaleMask:
    """The environment with its one fault."""
    return StaleMask(**kwargs)
