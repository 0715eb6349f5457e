"""`close` raises where there is nothing to close, or nothing any more."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK525",)


class ClosesOnce(Rovers):
    """Closes a window that it may not have."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Opens a window."""
        self.window: Any = object()
        return super().reset(seed, options)

    def close(self) -> None:
        """Closes it, whether or not it is there."""
        del self.window


def make(**kwargs: Any) -> ClosesOnce:
    """The environment with its one fault."""
    return ClosesOnce(**kwargs)
