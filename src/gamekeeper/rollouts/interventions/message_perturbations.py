"""Perturbations of messages: they arrive as others, or not at all."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from gymnasium.spaces import Discrete
from numpy.random import Generator

from gamekeeper.episodes.outcome import Label
from gamekeeper.rollouts.interventions.sensors import (
    MessagePerturbation,
    ObservedParts,
    Sensor,
    blinder,
)
from gamekeeper.rollouts.interventions.value_parts import (
    MISSING,
    Floats,
    PartNumbers,
    ValuePart,
    numbers_of,
)


@dataclass(frozen=True, slots=True)
class MessageDrop(MessagePerturbation):
    """Sets the declared message fields in an agent's observation to zero at some turns.

    The agents are those that listen. Blank are zeros, or what the space has that is nearest to
    them; no text. The strength is the probability at each turn.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.5

    strength: float = USUAL

    def sensor(self, observed: ObservedParts, rng: Generator) -> Sensor:
        """Returns the sensor of an agent for one episode."""
        deafen, strength = blinder(observed.messages), self.strength
        return lambda observation: deafen(observation) if rng.random() < strength else observation


@dataclass(frozen=True, slots=True)
class MessageShuffle(MessagePerturbation):
    """Garbles the declared message fields in an agent's observation at some turns.

    The agents are those that listen. Several numbers come in another order (a word that stands as
    a one among zeros becomes another word), one of a Discrete space becomes any of the space, and
    a single number or a text becomes one that the agent got before in the episode. The strength
    is the probability at each turn.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.5

    strength: float = USUAL

    def sensor(self, observed: ObservedParts, rng: Generator) -> Sensor:
        """Returns the sensor of an agent for one episode."""
        numbers, strength = numbers_of(observed.messages), self.strength
        listed = {id(each.part) for each in numbers}
        shufflers = [_shuffler(each, rng) for each in numbers]
        shufflers += [_old_text(part, rng) for part in observed.messages if id(part) not in listed]

        def see(observation: Any) -> Any:
            is_struck = rng.random() < strength
            for shuffler in shufflers:
                shuffled = shuffler(observation)  # it draws and remembers also where none is struck
                observation = shuffled if is_struck else observation
            return observation

        return see


def _shuffler(numbers: PartNumbers, rng: Generator) -> Sensor:
    other: Callable[[Floats], Floats]
    if isinstance(numbers.part.space, Discrete):
        count = numbers.high[0] - numbers.low[0] + 1
        other = partial(_any_number, numbers, count, rng)
    elif numbers.size > 1:
        other = rng.permutation
    else:
        memory: list[Floats] = []
        other = partial(_any_of, memory, rng=rng)

    def shuffle(observation: Any) -> Any:
        found = numbers.read(observation)
        return observation if found is None else numbers.write(observation, other(found))

    return shuffle


def _any_number(numbers: PartNumbers, count: float, rng: Generator, found: Floats) -> Floats:
    """Any of a Discrete space's numbers, whatever was found."""
    return numbers.low + float(int(rng.random() * count))


def _old_text(part: ValuePart, rng: Generator) -> Sensor:
    memory: list[Any] = []

    def shuffle(observation: Any) -> Any:
        value = part.of(observation)
        return (
            observation if value is MISSING else part.put(observation, _any_of(memory, value, rng))
        )

    return shuffle


def _any_of(memory: list[Any], new: Any, rng: Generator) -> Any:
    """One of those that are remembered, the new one among them."""
    memory.append(new)
    return memory[int(rng.random() * len(memory))]
