"""A clean environment that declares its endings and its horizon: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS: tuple[str, ...] = ()
CONTRACT = {
    "schedule": {"horizon": 20},
    "endings": {
        "battery": {"kind": "termination", "owner": "agent"},
        "horizon": {"kind": "truncation", "owner": "all"},
    },
}


class Endings(Rovers):
    """Rovers whose ends have reasons, as they are declared."""

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


def make(**kwargs: Any) -> Endings:
    """The environment as it should be."""
    return Endings(**kwargs)
