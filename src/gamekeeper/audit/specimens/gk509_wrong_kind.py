"""An empty battery terminates, though it is declared a truncation."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK509",)
CONTRACT = {
    "endings": {
        "battery": {"kind": "truncation", "owner": "agent"},
        "horizon": {"kind": "truncation", "owner": "all"},
    }
}


class WrongKind(Rovers):
    """Batteries are declared a limit from outside."""

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


def make(**kwargs: Any) -> WrongKind:
    """The environment with its one fault."""
    return WrongKind(**kwargs)
