"""render() draws, and forgets to return what it drew."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK802",)


class NoFrame(Traders):
    """Shows its picture to nobody."""

    def render(self) -> Any:
        """Draws in vain."""
        super().render()


def make(**kwargs: Any) -> NoFrame:
    """The environment with its one fault."""
    return NoFrame(**kwargs)
