"""A step after which nobody is left returns four values, as it did before truncations."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK110",)
ALSO = ("GK501",)
"""Without two flags by agent nobody is told to have ended."""


class FourValues(Rovers):
    """The last step is told in the old form."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Mixes both flags at the end."""
        out = super().step(actions)
        if self.agents or not out[0]:
            return out
        return out[0], out[1], {a: out[2][a] or out[3][a] for a in out[2]}, out[4]


def make(**kwargs: Any) -> FourValues:
    """The environment with its one fault."""
    return FourValues(**kwargs)
