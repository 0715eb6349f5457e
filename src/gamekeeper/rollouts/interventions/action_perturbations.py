"""Perturbations of actions: something else is carried out than an agent chose."""

import copy
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium.spaces import Box
from numpy.random import Generator

from gamekeeper.episodes.outcome import Label
from gamekeeper.rollouts.interventions.legal_actions import (
    ActionPerturbation,
    Actuator,
    Flags,
    LegalActions,
)
from gamekeeper.rollouts.interventions.perturbation import Unit
from gamekeeper.rollouts.interventions.value_parts import (
    Floats,
    PartNumbers,
    are_numbers,
    numbers_of,
)


@dataclass(frozen=True, slots=True)
class ActionDropout(ActionPerturbation):
    """Replaces an agent's action by its noop at some turns.

    It does the declared noop; where none is declared, what it last did of its own choice (at first,
    what it chooses). What is illegal now gives way to the noop, else to the first legal action. The
    strength is the probability at each turn.
    """

    label: ClassVar[Label] = "control"
    USUAL: ClassVar[float] = 0.5

    strength: float = USUAL

    def actuator(self, legal_actions: LegalActions, rng: Generator) -> Actuator:
        """Returns the actuator of an agent for one episode."""
        strength, last = self.strength, None

        def do(action: Any) -> Any:
            nonlocal last
            if rng.random() >= strength:
                last = copy.deepcopy(action)
                return action
            if legal_actions.has_noop:
                return legal_actions.noop(action)
            return action if last is None else copy.deepcopy(last)

        return do


@dataclass(frozen=True, slots=True)
class ActionNoise(ActionPerturbation):
    """Adds noise to an agent's actions; a discrete one becomes another legal one at some turns.

    The strength is the probability, at each turn and for each whole number of an action by itself,
    that another legal value takes its place, each as likely as any other; a Box's numbers all get a
    normal number added, whose standard deviation is the strength as a part of the declared range
    (of what the agent has done so far, 0 counted, where none is declared), and stay in the space.
    """

    label: ClassVar[Label] = "control"
    USUAL: ClassVar[float] = 0.3

    strength: float = USUAL

    @classmethod
    def lacks(cls, legal_actions: LegalActions) -> str | None:
        """Not to an agent whose actions have no numbers."""
        return (
            None
            if any(are_numbers(x.space) for x in legal_actions.parts)
            else "its actions have no numbers"
        )

    def actuator(self, legal_actions: LegalActions, rng: Generator) -> Actuator:
        """Returns the actuator of an agent for one episode."""
        numbers, strength = numbers_of(legal_actions.parts), self.strength

        def do(action: Any) -> Any:
            for each in numbers:
                found = each.read(action)
                if isinstance(each.part.space, Box):
                    noise = strength * each.width * rng.standard_normal(each.size)
                    noisy = None if found is None else found + noise
                else:
                    draws = rng.random((2, each.size))
                    noisy = (
                        None
                        if found is None
                        else _others(each, found, draws, strength, legal_actions)
                    )
                if noisy is not None:
                    action = each.write(action, noisy)
            return action

        return do


def _others(
    numbers: PartNumbers, found: Floats, draws: Floats, strength: float, legal_actions: LegalActions
) -> Floats | None:
    """The numbers, with others where they are struck; None where nothing changes."""
    flags = legal_actions.flags(numbers.part)
    changed = found.copy()
    for at in np.flatnonzero(draws[0] < strength):
        legal = _legal(numbers, int(at), flags)
        others = legal[legal != found[at]]
        if others.size:
            changed[at] = others[int(draws[1, at] * others.size)]
    return None if np.array_equal(changed, found) else changed


def _legal(numbers: PartNumbers, at: int, flags: tuple[Flags, ...] | None) -> Floats:
    values = np.arange(numbers.low[at], numbers.high[at] + 1)
    return values if flags is None else values[flags[at]]


NOT_CONTINUOUS: Final = "its actions are no numbers between bounds"


@dataclass(frozen=True, slots=True)
class ActionSaturation(ActionPerturbation):
    """Clips a Box action to a narrower range than declared.

    The range shrinks towards the declared noop; where there is none, towards 0 or what is nearest
    to it. The strength is the part of the range that is lost: at 1 only the noop is left.
    """

    label: ClassVar[Label] = "control"
    USUAL: ClassVar[float] = 0.5
    UNIT: ClassVar[Unit] = "part"

    strength: float = USUAL

    @classmethod
    def lacks(cls, legal_actions: LegalActions) -> str | None:
        """Only to an agent whose actions are numbers of a bounded Box."""
        return None if _continuous(legal_actions) else NOT_CONTINUOUS

    def actuator(self, legal_actions: LegalActions, rng: Generator) -> Actuator:
        """Returns the actuator of an agent for one episode."""
        ranges = [
            (each, *_range(each, legal_actions, 1 - self.strength))
            for each in _continuous(legal_actions)
        ]

        def do(action: Any) -> Any:
            for each, low, high in ranges:
                found = each.read(action)
                if found is None:
                    continue
                cut = np.clip(found, low, high)
                if not np.array_equal(cut, found, equal_nan=True):
                    action = each.write(action, cut)
            return action

        return do


def _continuous(legal_actions: LegalActions) -> list[PartNumbers]:
    found = numbers_of(part for part in legal_actions.parts if isinstance(part.space, Box))
    return [each for each in found if each.is_bounded.any()]


def _range(numbers: PartNumbers, legal_actions: LegalActions, left: float) -> tuple[Floats, Floats]:
    still = numbers.read(legal_actions.noop(None)) if legal_actions.has_noop else None
    centre = numbers.blank() if still is None else still
    ends = (np.where(numbers.is_bounded, end, centre) for end in (numbers.low, numbers.high))
    low, high = (centre + (end - centre) * left for end in ends)
    bounded = numbers.is_bounded
    return np.where(bounded, low, numbers.low), np.where(bounded, high, numbers.high)


@dataclass(frozen=True, slots=True)
class Frozen(ActionPerturbation):
    """Repeats an agent's first action at every turn.

    Where that is illegal, the declared noop stands in, else the first legal action. The strength is
    the probability at each turn; at 1 nothing is left of the agent's plan but its first action.
    """

    label: ClassVar[Label] = "planning"
    USUAL: ClassVar[float] = 1.0

    strength: float = USUAL

    def actuator(self, legal_actions: LegalActions, rng: Generator) -> Actuator:
        """Returns the actuator of an agent for one episode."""
        strength, first = self.strength, list[Any]()

        def do(action: Any) -> Any:
            is_struck = rng.random() < strength
            if not first:
                first.append(copy.deepcopy(action))
                return action
            return copy.deepcopy(first[0]) if is_struck else action

        return do


@dataclass(frozen=True, slots=True)
class StickyActions(ActionPerturbation):
    """Repeats an agent's previous action at some turns.

    Where that is illegal now, the declared noop stands in, else the first legal action. The
    strength is the probability at each turn.

    Source: Machado et al. 2018, "Revisiting the Arcade Learning Environment" (there 0.25).
    """

    label: ClassVar[Label] = "control"
    USUAL: ClassVar[float] = 0.5

    strength: float = USUAL

    def actuator(self, legal_actions: LegalActions, rng: Generator) -> Actuator:
        """Returns the actuator of an agent for one episode."""
        strength, last = self.strength, None

        def do(action: Any) -> Any:
            nonlocal last
            if rng.random() < strength and last is not None:
                done = copy.deepcopy(last)
                last = last if legal_actions.allows(done) else legal_actions.stand_in(action)
                return done
            last = copy.deepcopy(action)
            return action

        return do
