"""Every reset goes through all ticks that ever were."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK832",)


class LogsOfAllEpisodes(Rovers):
    """A clean environment otherwise."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.log: list[int] = []

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The mean of all that was."""
        self.mean = sum(each for each in self.log) / max(len(self.log), 1)
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Writes the log."""
        self.log.extend(int(action) for action in actions.values())
        return super().step(actions)


def make(**kwargs: Any) -> LogsOfAllEpisodes:
    """The environment with its one fault."""
    return LogsOfAllEpisodes(**kwargs)
