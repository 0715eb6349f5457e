"""Stressors of what agents see: hooks that show a policy something else than was given."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gymnasium.spaces import Space
from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.game.door import AgentId
from gamekeeper.run.stress.numbers import are_numbers, numbers_of
from gamekeeper.run.stress.part import (
    MISSING,
    Part,
    Path,
    blank_of_rare,
    joined,
    mask_path,
    message_parts,
    seen_parts,
)
from gamekeeper.run.stress.stressor import Stress, Stressor, observation_space

Eye = Callable[[Any], Any]
"""From what was given to what is shown; called once at each of an agent's turns."""


@dataclass(frozen=True, slots=True)
class Sight:
    """What an agent sees.

    Attributes:
        space: of its observations.
        parts: of the space, without the mask.
        messages: those of them that are declared to carry messages.
        mask: where its mask stands in it, if it does.
    """

    space: Space[Any]
    parts: tuple[Part, ...]
    messages: tuple[Part, ...]
    mask: Path | None

    def as_now(self, old: Any, observation: Any) -> Any:
        """A copy of what was seen before, with the mask that holds now."""
        kept = copy.deepcopy(old)
        if self.mask is None:
            return kept
        place = Part(self.mask, self.space)
        mask = place.of(observation)
        return kept if mask is MISSING or place.of(kept) is MISSING else place.put(kept, mask)


def sight_of(contract: Contract, env: Any, agent: AgentId) -> Sight | None:
    """What an agent sees; None where the environment doesn't say."""
    space = observation_space(env, agent)
    if space is None:
        return None
    mask = mask_path(contract, agent, space)
    parts, messages = seen_parts(contract, agent, space), message_parts(contract, agent, space)
    return Sight(space, parts, messages, mask)


class Seeing(Stress):
    """Hooks that give each agent an eye when it first looks."""

    def __init__(self, change: Stressor, rng: Generator) -> None:
        super().__init__(change, rng)
        self._eyes: dict[AgentId, Eye | None] = {}

    def sees(self, turn: int, agent: AgentId, observation: Any) -> Any:
        """What the agent's eye makes of it."""
        if agent not in self._eyes:
            self._eyes[agent] = self._opened(agent) if self.is_meant(agent) else None
        eye = self._eyes[agent]
        return observation if eye is None else eye(observation)

    def _opened(self, agent: AgentId) -> Eye | None:
        sight = sight_of(self.contract, self.env, agent)
        return None if sight is None else self.eye(sight, self.stream(agent))

    def eye(self, sight: Sight, rng: Generator) -> Eye:
        """The eye of an agent, for one play; it never writes into what was given."""
        raise NotImplementedError


def blinder(parts: tuple[Part, ...]) -> Eye:
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


def sees_no_numbers(contract: Contract, env: Any, agent: AgentId) -> str | None:
    """Why noise can't be tried on an agent."""
    sight = sight_of(contract, env, agent)
    if sight is None:
        return "the environment doesn't say what it may see"
    return None if numbers_of(sight.parts) else "nothing that it sees is a number"


def sees_nothing(contract: Contract, env: Any, agent: AgentId) -> str | None:
    """Why an agent can't be blinded."""
    sight = sight_of(contract, env, agent)
    if sight is None:
        return "the environment doesn't say what it may see"
    return None if sight.parts else "it sees nothing but its mask"


def hears_nothing(contract: Contract, env: Any, agent: AgentId) -> str | None:
    """Why messages to an agent can't be disturbed."""
    sight = sight_of(contract, env, agent)
    if sight is None:
        return "the environment doesn't say what it may see"
    return None if sight.messages else "no field that it sees is declared to carry messages"
