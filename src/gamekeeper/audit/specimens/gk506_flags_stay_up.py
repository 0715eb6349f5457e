"""After an episode in which a trader went bankrupt the next one begins with it terminated."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK506",)
ALSO = ("GK523", "GK604")
"""An episode that begins with one agent ended isn't that of a fresh instance."""


class FlagsStayUp(Traders):
    """Who was bankrupt once is so in the next episode."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Leaves one flag as it was."""
        bankrupt = getattr(self, "bankrupt", None)
        super().reset(seed, options)
        if bankrupt is not None:
            self.terminations[bankrupt] = True
        self.bankrupt: str | None = None

    def settle(self) -> None:
        """Notes a bankrupt trader."""
        super().settle()
        self.bankrupt = next((a for a in self.agents if self.terminations[a]), self.bankrupt)


def make(**kwargs: Any) -> FlagsStayUp:
    """The environment with its one fault."""
    return FlagsStayUp(**kwargs)
