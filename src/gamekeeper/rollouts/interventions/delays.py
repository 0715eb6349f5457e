"""Perturbations of time: observations and actions come late, or an agent acts more rarely."""

import copy
from collections import deque
from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.random import Generator

from gamekeeper.episodes.outcome import Label
from gamekeeper.rollouts.interventions.legal_actions import ActionPerturbation, Hand, Offer
from gamekeeper.rollouts.interventions.perturbation import Unit
from gamekeeper.rollouts.interventions.sights import AgentSight, Eye, ObservationPerturbation


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

    def hand(self, offer: Offer, rng: Generator) -> Hand:
        """Returns the hand of an agent for one episode."""
        turns, waiting = int(self.strength), deque[Any]()

        def do(action: Any) -> Any:
            waiting.append(copy.deepcopy(action))
            return waiting.popleft() if len(waiting) > turns else offer.stand_in(action)

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

    def eye(self, sight: AgentSight, rng: Generator) -> Eye:
        """Returns the eye of an agent for one episode."""
        seen: deque[Any] = deque(maxlen=int(self.strength) + 1)

        def see(observation: Any) -> Any:
            seen.append(copy.deepcopy(observation))
            return sight.as_now(seen[0], observation)

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
    def lacks(cls, offer: Offer) -> str | None:
        """Not to an agent without a declared noop: it can't wait."""
        return None if offer.has_noop else "no action is declared that does nothing"

    def hand(self, offer: Offer, rng: Generator) -> Hand:
        """Returns the hand of an agent for one episode."""
        every, turn = int(self.strength) + 1, -1

        def do(action: Any) -> Any:
            nonlocal turn
            turn += 1
            return offer.stand_in(action) if turn % every else action

        return do
