"""Every tick adds up the whole way again."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._long_rovers import LongRovers

BREAKS = ("GK831",)


class HistoryInLines(LongRovers):
    """A clean environment otherwise."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The way is empty."""
        self.way: list[Any] = []
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Adds it all up."""
        out = super().step(actions)
        self.way.append(sum(map(int, actions.values())))
        self.length = 0
        for part in self.way:
            self.length += part
        return out


def make(**kwargs: Any) -> HistoryInLines:
    """The environment with its one fault."""
    return HistoryInLines(**kwargs)
