"""reset writes its defaults into the caller's options."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK632",)


class OptionsFilledIn(Rovers):
    """The caller's options are filled in."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Notes the horizon in the options."""
        if options is not None:
            options.setdefault("horizon", self.horizon)
        return super().reset(seed, options)


def make(**kwargs: Any) -> OptionsFilledIn:
    """The environment with its one fault."""
    return OptionsFilledIn(**kwargs)
