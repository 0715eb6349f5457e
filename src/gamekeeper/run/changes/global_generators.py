"""The generators that all of a process shares, seeded anew all the time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.random import Generator

from gamekeeper.run.change import Change, Hooks
from gamekeeper.run.global_generators import restore, seed_all, states


@dataclass(frozen=True, slots=True)
class GlobalGeneratorsDisturbed(Change):
    """Seeds numpy.random, random and torch before the reset and between all turns.

    A learner draws from them too; an environment with a generator of its own doesn't notice.
    Afterwards they are as they were before.
    """

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Disturbing(rng)


class _Disturbing(Hooks):
    def __init__(self, rng: Generator) -> None:
        self._rng = rng
        self._kept: dict[str, Any] | None = None

    def before_reset(self, env: Any) -> None:
        """Remembers how they were."""
        self._kept = states()
        self._disturb()

    def between(self, turn: int, env: Any) -> None:
        """Another seed at every turn."""
        self._disturb()

    def after(self, env: Any) -> None:
        """Puts them back."""
        if self._kept is not None:
            restore(self._kept)

    def _disturb(self) -> None:
        seed_all(int(self._rng.integers(1 << 31)))
