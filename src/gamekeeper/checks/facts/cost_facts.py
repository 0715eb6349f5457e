"""Facts of the probes `long` and `repeated`."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TurnWork:
    """Work of each turn of a long episode; empty where no turn was played.

    Attributes:
        live: agents in the roster.
        lines: lines of Python run.
        passing: bytes at the peak.
        sizes: bytes in use before it.
    """

    live: tuple[int, ...]
    lines: tuple[int, ...]
    passing: tuple[int, ...]
    sizes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class EpisodeWork:
    """Work of each of equal episodes, its reset included.

    Attributes:
        lines: lines of Python run.
        passing: bytes at the peak.
        sizes: bytes in use after it.
    """

    lines: list[int]
    passing: list[int]
    sizes: list[int]
