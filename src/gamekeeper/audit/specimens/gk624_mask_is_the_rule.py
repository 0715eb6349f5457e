"""The mask that is handed out is the array that step asks what is legal."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS = ("GK624",)


class MaskIsTheRule(Tokens):
    """The mask is the rule itself."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """The rules' array begins as they have it."""
        super().reset(seed, options)
        self.rule = self.legal()

    def observe(self, agent: str) -> dict[str, Any]:
        """The mask of who is next is the rules' own array."""
        seen = super().observe(agent)
        if agent == self.agent_selection and seen["action_mask"].any():
            seen["action_mask"] = self.rule
        return seen

    def step(self, action: Any) -> None:
        """Asks the array that was handed out."""
        if action is not None and not self.rule[int(action)]:
            raise ValueError(f"cell {action} is taken")
        super().step(action)
        self.rule = self.legal()


def make(**kwargs: Any) -> MaskIsTheRule:
    """The environment with its one fault."""
    return MaskIsTheRule(**kwargs)
