"""All rovers are given views of one array that lie upon each other."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK614",)


class OneViewForAll(Rovers):
    """Every rover sees the same array."""

    def step(self, actions: dict[str, Any]) -> Any:
        """One array for all."""
        observations, *rest = super().step(actions)
        view = next(iter(observations.values()), None)
        return dict.fromkeys(observations, view), *rest


def make(**kwargs: Any) -> OneViewForAll:
    """The environment with its one fault."""
    return OneViewForAll(**kwargs)
