"""`reset` knows no options."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK524",)


class NoOptions(Rovers):
    """Its reset takes a seed alone."""

    def reset(self, seed: int | None = None) -> Any:  # type: ignore[override]  # that is the fault
        """Has no `options`."""
        return super().reset(seed)


def make(**kwargs: Any) -> NoOptions:
    """The environment with its one fault."""
    return NoOptions(**kwargs)
