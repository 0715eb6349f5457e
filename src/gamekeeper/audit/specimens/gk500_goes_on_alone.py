"""An ending that is declared to be everybody's ends only the rover that it befalls."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK500",)
CONTRACT = {
    "endings": {
        "battery": {"kind": "termination", "owner": "all"},
        "horizon": {"kind": "truncation", "owner": "all"},
    }
}


class GoesOnAlone(Rovers):
    """An empty battery is declared to be the end for all."""

    endings: dict[str, str]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nothing has ended."""
        self.endings = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Names the reasons."""
        out = super().step(actions)
        self.endings.update((a, "battery") for a in out[2] if out[2][a])
        self.endings.update((a, "horizon") for a in out[3] if out[3][a])
        return out


def make(**kwargs: Any) -> GoesOnAlone:
    """The environment with its one fault."""
    return GoesOnAlone(**kwargs)
