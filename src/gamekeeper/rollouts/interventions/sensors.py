"""Sensors of agents: perturbations that show a policy something else than was given."""

import copy
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from gymnasium.spaces import Space
from numpy.random import Generator

from gamekeeper.contract import Contract
from gamekeeper.interface.capture import AgentId
from gamekeeper.rollouts.intervention import Hooks
from gamekeeper.rollouts.interventions.perturbation import (
    Perturbation,
    PerturbationHooks,
    Unit,
    observation_space,
)
from gamekeeper.rollouts.interventions.value_parts import (
    MISSING,
    Floats,
    Path,
    ValuePart,
    are_numbers,
    blank_of_rare,
    joined,
    mask_path,
    message_parts,
    numbers_of,
    seen_parts,
)

Sensor = Callable[[Any], Any]
"""From what was given to what is shown; called once at each of an agent's turns."""


@dataclass(frozen=True, slots=True)
class ObservedParts:
    """Fields of an agent's observation that a perturbation may touch.

    Attributes:
        parts: of the space, without the mask.
        messages: those of them that are declared to carry messages.
        mask: where its mask stands in it, if it does.
    """

    space: Space[Any]
    parts: tuple[ValuePart, ...]
    messages: tuple[ValuePart, ...]
    mask: Path | None

    def as_now(self, old: Any, observation: Any) -> Any:
        """A copy of what was seen before, with the mask that holds now."""
        kept = copy.deepcopy(old)
        if self.mask is None:
            return kept
        place = ValuePart(self.mask, self.space)
        mask = place.of(observation)
        return kept if mask is MISSING or place.of(kept) is MISSING else place.put(kept, mask)


def observed_parts(contract: Contract, env: Any, agent: AgentId) -> ObservedParts | None:
    """Fields of an agent's observation; None where the environment doesn't say."""
    space = observation_space(env, agent)
    if space is None:
        return None
    mask = mask_path(contract, agent, space)
    parts, messages = seen_parts(contract, agent, space), message_parts(contract, agent, space)
    return ObservedParts(space, parts, messages, mask)


@dataclass(frozen=True, slots=True)
class ObservationPerturbation(Perturbation):
    """Gives each agent a sensor, which shows its policy something else than was given."""

    ON: ClassVar[Literal["seen", "done"]] = "seen"

    def start(self, rng: Generator) -> Hooks:
        """Returns the hooks for one episode."""
        return _ObservationHooks(self, rng) if self.strength else Hooks()

    @abstractmethod
    def sensor(self, observed: ObservedParts, rng: Generator) -> Sensor:
        """Returns the sensor of an agent, for one episode; it never writes into what was given."""

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent that sees nothing anyway."""
        observed = observed_parts(contract, env, agent)
        if observed is None:
            return "the environment doesn't say what it may see"
        return cls.lacks(observed)

    @classmethod
    def lacks(cls, observed: ObservedParts) -> str | None:
        """Returns why an agent can't be perturbed like that; None where it can."""
        return None if observed.parts else "it sees nothing but its mask"


@dataclass(frozen=True, slots=True)
class NumberPerturbation(ObservationPerturbation):
    """Adds normal numbers to the numbers that an agent sees."""

    UNIT: ClassVar[Unit] = "deviation"

    @abstractmethod
    def offset(self, size: int, rng: Generator) -> Callable[[], Floats]:
        """Returns a function that gives [size] offsets turn by turn, in deviations."""

    def sensor(self, observed: ObservedParts, rng: Generator) -> Sensor:
        """Returns the sensor of an agent for one episode."""
        offsets = [(each, self.offset(each.size, rng)) for each in numbers_of(observed.parts)]
        strength = self.strength

        def see(observation: Any) -> Any:
            for each, offset in offsets:
                drawn, found = offset(), each.read(observation)
                if found is not None:
                    observation = each.write(observation, found + strength * each.width * drawn)
            return observation

        return see

    @classmethod
    def lacks(cls, observed: ObservedParts) -> str | None:
        """Returns why it can't be tried on an agent that sees no numbers."""
        return None if numbers_of(observed.parts) else "nothing that it sees is a number"


@dataclass(frozen=True, slots=True)
class MessagePerturbation(ObservationPerturbation):
    """Changes the declared message fields that an agent sees."""

    @classmethod
    def lacks(cls, observed: ObservedParts) -> str | None:
        """Returns why it can't be tried on an agent that sees no declared message field."""
        declared = "no field that it sees is declared to carry messages"
        return None if observed.messages else declared


class _ObservationHooks(PerturbationHooks):
    """Hooks that give each agent a sensor when it first observes."""

    def __init__(self, perturbation: ObservationPerturbation, rng: Generator) -> None:
        super().__init__(perturbation, rng)
        self._sensor = perturbation.sensor
        self._sensors: dict[AgentId, Sensor | None] = {}

    def sees(self, turn: int, agent: AgentId, observation: Any) -> Any:
        """Observation as the agent's sensor passes it on."""
        if agent not in self._sensors:
            self._sensors[agent] = self._opened(agent) if self.is_meant(agent) else None
        sensor = self._sensors[agent]
        return observation if sensor is None else sensor(observation)

    def _opened(self, agent: AgentId) -> Sensor | None:
        observed = observed_parts(self.contract, self.env, agent)
        return None if observed is None else self._sensor(observed, self.stream(agent))


def blinder(parts: tuple[ValuePart, ...]) -> Sensor:
    """Shows nothing where these parts stand: 0 or what is nearest to it, no text, no items."""
    numbers = [(each, each.blank()) for each in numbers_of(joined(parts))]
    others = [part for part in parts if not are_numbers(part.space)]

    def blind(observation: Any) -> Any:
        for each, blank in numbers:
            if each.read(observation) is not None:
                observation = each.write(observation, blank)
        for part in others:
            value = part.of(observation)
            if value is not MISSING:
                observation = part.put(observation, blank_of_rare(part.space, value))
        return observation

    return blind
