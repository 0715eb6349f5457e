"""Other futures for generators: of the environment, and of the whole process."""

from dataclasses import dataclass
from typing import Any

from numpy.random import Generator

from gamekeeper.rollouts.intervention import Hooks, Intervention
from gamekeeper.rollouts.process_randomness import (
    kept_global_generators,
    reseed,
    restore,
    seed_all,
    states,
)


@dataclass(frozen=True, slots=True)
class GeneratorsElsewhere(Intervention):
    """Changes the state of some of the environment's generators after the reset.

    A game that draws nothing from them plays on as it did.

    Attributes:
        places: which of them, as `process_randomness.standing` counts them.
        number: equal numbers give equal futures; in [0, 2**31).
    """

    places: tuple[int, ...] = ()
    number: int = 0

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one episode; they draw nothing."""
        return _Elsewhere(self)


class _Elsewhere(Hooks):
    def __init__(self, change: GeneratorsElsewhere) -> None:
        self._change = change

    def between(self, turn: int, env: Any) -> None:
        if turn == 0:
            with kept_global_generators():
                reseed(env, self._change.number, self._change.places)


@dataclass(frozen=True, slots=True)
class GlobalGeneratorsDisturbed(Intervention):
    """Seeds numpy.random, random and torch before the reset and between turns.

    A learner draws from them too; an environment with a generator of its own doesn't notice.
    Afterwards they are as they were before.
    """

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one episode."""
        return _Disturbing(rng)


class _Disturbing(Hooks):
    def __init__(self, rng: Generator) -> None:
        self._rng = rng
        self._kept: dict[str, Any] | None = None

    def before_reset(self, env: Any) -> None:
        self._kept = states()
        self._disturb()

    def between(self, turn: int, env: Any) -> None:
        self._disturb()

    def after(self, env: Any) -> None:
        if self._kept is not None:
            restore(self._kept)

    def _disturb(self) -> None:
        seed_all(int(self._rng.integers(1 << 31)))
