"""Samples lie where they lay at the end of the episode before."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK604",)


class KeptSamples(Rovers):
    """What was found outlasts a reset."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Places rovers, and samples only where there are none."""
        kept = getattr(self, "samples", None)
        super().reset(seed, options)
        self.samples = kept or self.samples
        return {a: self.observation(a) for a in self.agents}, {a: self.info(a) for a in self.agents}


def make(**kwargs: Any) -> KeptSamples:
    """The environment with its one fault."""
    return KeptSamples(**kwargs)
