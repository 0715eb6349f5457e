"""An environment's own generators, somewhere else in their streams once a reset has begun them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.random import Generator

from gamekeeper.run.change import Change, Hooks
from gamekeeper.run.reseed import kept_global_generators, reseed_some


@dataclass(frozen=True, slots=True)
class GeneratorsElsewhere(Change):
    """Gives some of the generators that the environment holds another future after the reset.

    A game that draws nothing from them plays on as it did.

    Attributes:
        places: which of them, as `run.reseed.standing` counts them.
        number: equal numbers give equal futures; in [0, 2**31).
    """

    places: tuple[int, ...] = ()
    number: int = 0

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play; they draw nothing."""
        return _Elsewhere(self)


class _Elsewhere(Hooks):
    def __init__(self, change: GeneratorsElsewhere) -> None:
        self._change = change

    def between(self, turn: int, env: Any) -> None:
        """Once, right after the reset."""
        if turn == 0:
            with kept_global_generators():
                reseed_some(env, self._change.number, self._change.places)
