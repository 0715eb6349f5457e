"""A reset in the midst of an episode is ignored."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK523",)
ALSO = ("GK103", "GK604", "GK606")
"""Where a reset is ignored, so is its seed, the second episode isn't a fresh one's, and who had
left stays away."""


class ResetIgnored(Rovers):
    """Resets only what is over."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Gives what is there, while there is somebody."""
        if not self.agents:
            return super().reset(seed, options)
        observations = {a: self.observation(a) for a in self.agents}
        return observations, {a: self.info(a) for a in self.agents}


def make(**kwargs: Any) -> ResetIgnored:
    """The environment with its one fault."""
    return ResetIgnored(**kwargs)
