"""Perturbations of observations: a policy is shown something else than the agent was given."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.random import Generator

from gamekeeper.episodes.message_field import message_field
from gamekeeper.episodes.outcome import Label
from gamekeeper.errors import SpecError
from gamekeeper.rollouts.interventions.perturbation import Perturbation, Unit
from gamekeeper.rollouts.interventions.sensors import (
    NumberPerturbation,
    ObservationPerturbation,
    ObservedParts,
    Sensor,
    blinder,
)
from gamekeeper.rollouts.interventions.value_parts import Floats, ValuePart, named_parts


@dataclass(frozen=True, slots=True)
class ObservationNoise(NumberPerturbation):
    """Adds normal noise to an agent's observations.

    Whole numbers are rounded, and all stay in the space. The mask is left alone. The strength is
    the standard deviation as a part of the number's declared range; where no bounds are declared
    (or they are more than 1e9 apart), of the span of what the agent has seen there so far, 0
    counted.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.2
    MOST: ClassVar[float] = 2.0

    strength: float = USUAL

    def offset(self, size: int, rng: Generator) -> Callable[[], Floats]:
        """Returns a function that draws anew."""
        return lambda: rng.standard_normal(size)


@dataclass(frozen=True, slots=True)
class ObservationBias(NumberPerturbation):
    """Adds an offset to an agent's observations, drawn once an episode.

    Offsets are normal; whole numbers are rounded, and all stay in the space. The mask is left
    alone. The strength is the standard deviation over episodes as a part of the number's declared
    range; where no bounds are declared, of the span of what the agent has seen there so far, 0
    counted, so that the offset is only as constant as that span.
    """

    label: ClassVar[Label] = "state estimation"
    USUAL: ClassVar[float] = 0.2
    MOST: ClassVar[float] = 2.0

    strength: float = USUAL

    def offset(self, size: int, rng: Generator) -> Callable[[], Floats]:
        """Returns a function that gives the same offsets again and again."""
        drawn = rng.standard_normal(size)
        return lambda: drawn


@dataclass(frozen=True, slots=True)
class ObservationDrift(NumberPerturbation):
    """Adds a random walk to an agent's observations.

    A random walk from 0 that nothing brings back: after n turns its deviation is the strength times
    the root of n. Whole numbers are rounded, and all stay in the space; the mask is left alone. The
    strength is the deviation of a step as a part of the number's declared range; where no bounds
    are declared, of the span of what the agent has seen there so far, 0 counted.
    """

    label: ClassVar[Label] = "state estimation"
    USUAL: ClassVar[float] = 0.05
    MOST: ClassVar[float] = 0.5

    strength: float = USUAL

    def offset(self, size: int, rng: Generator) -> Callable[[], Floats]:
        """Returns a function that takes a step of the walk."""
        walk = np.zeros(size)

        def step() -> Floats:
            nonlocal walk
            walk = walk + rng.standard_normal(size)
            return walk

        return step


@dataclass(frozen=True, slots=True)
class ObservationDropout(ObservationPerturbation):
    """Sets an agent's whole observation to zero at some turns.

    Blank are zeros, or what the space has that is nearest to them; no text, no items. The mask is
    left alone. The strength is the probability at each turn.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.5

    strength: float = USUAL

    def sensor(self, observed: ObservedParts, rng: Generator) -> Sensor:
        """Returns the sensor of an agent for one episode."""
        blind, strength = blinder(observed.parts), self.strength
        return lambda observation: blind(observation) if rng.random() < strength else observation


@dataclass(frozen=True, slots=True)
class OccludedFields(ObservationPerturbation):
    """Sets a part of an agent's observation to zero for the whole episode.

    The fields are the parts of a Dict or Tuple observation, or each number where it is one array;
    which of them are hidden is drawn once an episode, so that a greater strength hides the same and
    more. Blank are zeros, or what the space has that is nearest to them; the mask is left alone.
    The strength is the part of the fields that is hidden, rounded up to whole fields.

    Attributes:
        fields: only these may be hidden, named as a contract names messages (`observation.goal`,
            `observation[4:6]`); None: all.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.5
    UNIT: ClassVar[Unit] = "part"

    strength: float = USUAL
    fields: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        Perturbation.__post_init__(self)
        for name in self.fields or ():
            message_field(name)  # or a ContractError now, and not in the middle of an episode

    def sensor(self, observed: ObservedParts, rng: Generator) -> Sensor:
        """Returns the sensor of an agent for one episode."""
        fields = _split(observed.parts)
        if self.fields is not None:
            named = (named_parts(name, observed.space, observed.parts) for name in self.fields)
            fields = [each for parts in named for each in parts]
        count = int(np.ceil(self.strength * len(fields) - 1e-9))
        hidden = rng.permutation(len(fields))[:count]
        return blinder(tuple(fields[at] for at in sorted(hidden)))


def _split(parts: tuple[ValuePart, ...]) -> list[ValuePart]:
    """The parts; a single array has no names, so each of its numbers is a field."""
    if len(parts) == 1 and isinstance(parts[0].space, Box):
        part = parts[0]
        count = int(np.prod(part.space.shape or ()))
        return [ValuePart(part.path, part.space, slice(at, at + 1)) for at in range(count)]
    return list(parts)


@dataclass(frozen=True, slots=True)
class StaleMemory(ObservationPerturbation):
    """Repeats an agent's last observation for bursts of turns.

    The mask is that of now. The strength is the probability, at each turn outside a burst, that one
    begins; during a burst the agent sees what it saw at the turn before it. The first turn is never
    stale, and neither is the one between two bursts.

    Attributes:
        turns: how many of the agent's own turns a burst lasts, from 1.
    """

    label: ClassVar[Label] = "state estimation"
    USUAL: ClassVar[float] = 0.25

    strength: float = USUAL
    turns: int = 5

    def __post_init__(self) -> None:
        Perturbation.__post_init__(self)
        if self.turns < 1:
            raise SpecError(
                "a burst can't be that short",
                where="turns",
                expected=">= 1",
                actual=str(self.turns),
                fix="let a burst last one turn or more",
            )

    def sensor(self, observed: ObservedParts, rng: Generator) -> Sensor:
        """Returns the sensor of an agent for one episode."""
        strength, turns = self.strength, self.turns
        left, memory = 0, None

        def see(observation: Any) -> Any:
            nonlocal left, memory
            is_struck = rng.random() < strength
            if left > 1:
                left -= 1
            elif left == 0 and is_struck and memory is not None:
                left = turns
            else:
                left, memory = 0, copy.deepcopy(observation)
                return observation
            return observed.as_now(memory, observation)

        return see
