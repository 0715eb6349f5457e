"""Perturbations of time: observations and actions come late, or an agent acts more rarely."""

import copy
from collections import deque
from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.random import Generator

from gamekeeper.episodes.outcome import Label
from gamekeeper.rollouts.interventions.legal_actions import (
    ActionPerturbation,
    Actuator,
    LegalActions,
)
from gamekeeper.rollouts.interventions.perturbation import Unit
from gamekeeper.rollouts.interventions.sensors import ObservationPerturbation, ObservedParts, Sensor


@dataclass(frozen=True, slots=True)
class ActionDelay(ActionPerturbation):
    """Delays an agent's actions by some of its own turns.

    Until the first of them is due, and where one is illegal when it is, the declared noop stands
    in, else the first legal action. The strength is the number of turns.
    """

    label: ClassVar[Label] = "timing"
    USUAL: ClassVar[float] = 2.0
    MOST: ClassVar[float] = 10.0
    UNIT: ClassVar[Unit] = "turns"

    strength: float = USUAL

    def actuator(self, legal_actions: LegalActions, rng: Generator) -> Actuator:
        """Returns the actuator of an agent for one episode."""
        turns, waiting = int(self.strength), deque[Any]()

        def do(action: Any) -> Any:
            waiting.append(copy.deepcopy(action))
            return waiting.popleft() if len(waiting) > turns else legal_actions.stand_in(action)

        return do


@dataclass(frozen=True, slots=True)
class ObservationDelay(ObservationPerturbation):
    """Delays an agent's observations by some of its own turns; at first it sees the first one.

    The mask is that of now. The strength is the number of turns.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 2.0
    MOST: ClassVar[float] = 10.0
    UNIT: ClassVar[Unit] = "turns"

    strength: float = USUAL

    def sensor(self, observed: ObservedParts, rng: Generator) -> Sensor:
        """Returns the sensor of an agent for one episode."""
        seen: deque[Any] = deque(maxlen=int(self.strength) + 1)

        def see(observation: Any) -> Any:
            seen.append(copy.deepcopy(observation))
            return observed.as_now(seen[0], observation)

        return see


@dataclass(frozen=True, slots=True)
class SlowerAgent(ActionPerturbation):
    """Replaces an agent's actions by its noop for some turns after each one.

    It does the declared noop; where that is illegal, the first legal action. The strength is the
    number of turns that it waits.
    """

    label: ClassVar[Label] = "timing"
    USUAL: ClassVar[float] = 1.0
    MOST: ClassVar[float] = 10.0
    UNIT: ClassVar[Unit] = "turns"

    strength: float = USUAL

    @classmethod
    def lacks(cls, legal_actions: LegalActions) -> str | None:
        """Not to an agent without a declared noop: it can't wait."""
        return None if legal_actions.has_noop else "no action is declared that does nothing"

    def actuator(self, legal_actions: LegalActions, rng: Generator) -> Actuator:
        """Returns the actuator of an agent for one episode."""
        every, turn = int(self.strength) + 1, -1

        def do(action: Any) -> Any:
            nonlocal turn
            turn += 1
            return legal_actions.stand_in(action) if turn % every else action

        return do
