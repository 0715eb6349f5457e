"""The rewards of every step come in one dictionary, which is written to."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK613",)


class RewardsUsedAgain(Rovers):
    """One dictionary of rewards."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """A dictionary for all steps."""
        self.paid: dict[str, float] = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """The same dictionary, written anew."""
        observations, rewards, *rest = super().step(actions)
        self.paid.clear()
        self.paid.update(rewards)
        return observations, self.paid, *rest


def make(**kwargs: Any) -> RewardsUsedAgain:
    """The environment with its one fault."""
    return RewardsUsedAgain(**kwargs)
