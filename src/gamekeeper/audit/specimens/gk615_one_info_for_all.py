"""All rovers are given one dictionary as their info."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK615",)


class OneInfoForAll(Rovers):
    """dict.fromkeys with a dictionary."""

    def step(self, actions: dict[str, Any]) -> Any:
        """One dictionary for all."""
        *rest, infos = super().step(actions)
        info = {"time": self.time}
        return *rest, dict.fromkeys(infos, info)


def make(**kwargs: Any) -> OneInfoForAll:
    """The environment with its one fault."""
    return OneInfoForAll(**kwargs)
