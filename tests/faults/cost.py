"""Steps that get slower, memory that grows."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.faults import faulty
from tests.faults.rovers import LongRovers, Rovers
from tests.faults.traders import Traders


@faulty("GK831", budget=4_000)
class HistoryInBytes(LongRovers):
    """Every tick makes one array of the whole history."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The history is empty."""
        out = super().reset(seed, options)
        self.history = np.zeros((0, 12))
        return out

    def step(self, actions: dict[str, Any]) -> Any:
        """One row more, in another array."""
        out = super().step(actions)
        self.history = np.concatenate([self.history, np.ones((1, 12))])
        return out


@faulty("GK831", budget=4_000)
class HistoryInLines(LongRovers):
    """Every tick adds up the whole way again."""

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


@faulty("GK832")
class LogsOfAllEpisodes(Rovers):
    """Every reset goes through all ticks that ever were."""

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


@faulty("GK833")
class EpisodesKept(Traders):
    """What every trader saw is kept for good."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.seen: list[Any] = []

    def step(self, action: Any) -> None:
        """Keeps what the one in turn sees."""
        self.seen.append(self.observe(self.agent_selection))
        super().step(action)


@faulty("GK832", "GK833")
class EpisodesReadAgain(EpisodesKept):
    """The same, and every reset goes through it."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """The most that was ever seen."""
        self.most = max((each.sum() for each in self.seen), default=0.0)
        super().reset(seed, options)


@faulty("GK832", "GK833")
class EpisodesCounted(EpisodesKept):
    """The same, and every reset counts its way up to itself: another line, another fault."""

    resets = 0

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Counts."""
        self.resets += 1
        for _ in range(50 * self.resets):
            pass
        super().reset(seed, options)


@faulty("GK834")
class FilmKept(LongRovers):
    """A film of the episode is kept until the reset."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Another film."""
        self.film: list[Any] = []
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """One picture more."""
        self.film.append(np.full((128, 128, 3), self.time, np.uint8))
        return super().step(actions)
