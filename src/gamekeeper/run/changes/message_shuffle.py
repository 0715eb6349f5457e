"""Messages that arrive as others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Literal

from gymnasium.spaces import Discrete
from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.numbers import Floats, Numbers, numbers_of
from gamekeeper.run.stress.part import MISSING, Part
from gamekeeper.run.stress.seeing import Eye, Seeing, Sight, hears_nothing
from gamekeeper.run.stress.stressor import Stressor


@dataclass(frozen=True, slots=True)
class MessageShuffle(Stressor):
    """Tells an agent something else at some turns, in the declared message fields that it sees.

    The agents are those that listen. Several numbers come in another order (a word that stands as
    a one among zeros becomes another word), one of a Discrete space becomes any of the space, and
    a single number or a text becomes one that the agent was told before in the play. The strength
    is the probability at each turn.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.5
    ON: ClassVar[Literal["seen", "done"]] = "seen"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Shuffled(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent without a declared message field among what it sees."""
        return hears_nothing(contract, env, agent)


class _Shuffled(Seeing):
    def eye(self, sight: Sight, rng: Generator) -> Eye:
        numbers, strength = numbers_of(sight.messages), self.strength
        listed = {id(each.part) for each in numbers}
        ears = [_ear(each, rng) for each in numbers]
        ears += [_old_text(part, rng) for part in sight.messages if id(part) not in listed]

        def see(observation: Any) -> Any:
            is_struck = rng.random() < strength
            for ear in ears:
                shuffled = ear(observation)  # also where nothing is struck: it draws and remembers
                observation = shuffled if is_struck else observation
            return observation

        return see


def _ear(numbers: Numbers, rng: Generator) -> Eye:
    told: Callable[[Floats], Floats]
    if isinstance(numbers.part.space, Discrete):
        count = numbers.high[0] - numbers.low[0] + 1
        told = partial(_any_number, numbers, count, rng)
    elif numbers.size > 1:
        told = rng.permutation
    else:
        memory: list[Floats] = []
        told = partial(_any_of, memory, rng=rng)

    def hear(observation: Any) -> Any:
        found = numbers.read(observation)
        return observation if found is None else numbers.write(observation, told(found))

    return hear


def _any_number(numbers: Numbers, count: float, rng: Generator, found: Floats) -> Floats:
    """Any of a Discrete space's numbers, whatever was found."""
    return numbers.low + float(int(rng.random() * count))


def _old_text(part: Part, rng: Generator) -> Eye:
    memory: list[Any] = []

    def hear(observation: Any) -> Any:
        value = part.of(observation)
        return (
            observation if value is MISSING else part.put(observation, _any_of(memory, value, rng))
        )

    return hear


def _any_of(memory: list[Any], new: Any, rng: Generator) -> Any:
    """One of those that are remembered, the new one among them."""
    memory.append(new)
    return memory[int(rng.random() * len(memory))]
