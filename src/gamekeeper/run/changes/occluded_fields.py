"""Fields of an observation that an agent never sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.core.message_field import message_field
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.part import Part, named_parts
from gamekeeper.run.stress.seeing import Eye, Seeing, Sight, blinder, sees_nothing, sight_of
from gamekeeper.run.stress.stressor import Stressor, Unit


@dataclass(frozen=True, slots=True)
class OccludedFields(Stressor):
    """Blanks a part of what an agent sees for the whole episode.

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
    ON: ClassVar[Literal["seen", "done"]] = "seen"

    strength: float = USUAL
    fields: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        Stressor.__post_init__(self)
        for name in self.fields or ():
            message_field(name)  # or a ContractError now, and not in the middle of a play

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Occluded(self, rng, self.fields) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent that sees nothing anyway."""
        return sees_nothing(contract, env, agent)


class _Occluded(Seeing):
    def __init__(self, change: Stressor, rng: Generator, fields: tuple[str, ...] | None) -> None:
        super().__init__(change, rng)
        self._fields = fields

    def eye(self, sight: Sight, rng: Generator) -> Eye:
        fields = _split(sight.parts)
        if self._fields is not None:
            named = (named_parts(name, sight.space, sight.parts) for name in self._fields)
            fields = [each for parts in named for each in parts]
        count = int(np.ceil(self.strength * len(fields) - 1e-9))
        hidden = rng.permutation(len(fields))[:count]
        return blinder(tuple(fields[at] for at in sorted(hidden)))


def _split(parts: tuple[Part, ...]) -> list[Part]:
    """The parts; a single array has no names, so each of its numbers is a field."""
    if len(parts) == 1 and isinstance(parts[0].space, Box):
        part = parts[0]
        count = int(np.prod(part.space.shape or ()))
        return [Part(part.path, part.space, slice(at, at + 1)) for at in range(count)]
    return list(parts)


def fields_of(contract: Contract, env: Any, agent: AgentId) -> tuple[str, ...]:
    """The fields that an agent sees, by the names that `OccludedFields` takes."""
    sight = sight_of(contract, env, agent)
    return () if sight is None else tuple(map(str, _split(sight.parts)))
