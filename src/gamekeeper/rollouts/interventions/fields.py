"""Fields: the numbers of an observation or an action, one by one, by their places in it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Space

from gamekeeper.contract import Contract
from gamekeeper.interface.capture import AgentId
from gamekeeper.rollouts.interventions.value_parts import (
    PartNumbers,
    ValuePart,
    are_numbers,
    numbers_of,
    parts_of,
    scalar_like,
    seen_parts,
)


@dataclass(frozen=True, slots=True, eq=False)
class NumberField:
    """One number of an observation, or of an action.

    Attributes:
        place: its place among all numbers, from 0, in the order of the parts.
        name: `field 3`; where the space has several parts, with the part: `field goal[1]`.
        low, high: bounds of its space; infinite where none are declared.
        part: the part of the space that it stands in.
        index: its place in that part.
    """

    place: int
    name: str
    low: float
    high: float
    part: ValuePart
    index: int

    def __str__(self) -> str:
        return self.name

    @property
    def is_whole(self) -> bool:
        """Tells whether its values are whole numbers."""
        dtype = self.part.space.dtype
        return dtype is not None and dtype.kind != "f"

    def read(self, whole: Any) -> float | None:
        """Value of the field; None where it hasn't the declared form."""
        try:
            return float(np.asarray(self.part.of(whole)).reshape(-1)[self.index])
        except (TypeError, ValueError, IndexError):
            return None

    def write(self, whole: Any, number: float) -> Any:
        """The same with another value there, of the same type; it isn't kept within bounds."""
        value = self.part.of(whole)
        if not isinstance(value, np.ndarray | list):
            return self.part.put(whole, scalar_like(value, number))
        array = np.array(value, order="C")
        is_whole = array.dtype.kind in "biu"
        array.reshape(-1)[self.index] = round(number) if is_whole else number
        return self.part.put(whole, array if isinstance(value, np.ndarray) else array.tolist())


def fields_in(parts: Sequence[ValuePart]) -> tuple[NumberField, ...]:
    """The numbers of these parts, one by one."""
    numbers = numbers_of(part for part in parts if are_numbers(part.space))
    found: list[NumberField] = []
    for each in numbers:
        for index in range(each.size):
            name = f"field {len(found)}" if len(numbers) == 1 else _named(each, index)
            low, high = float(each.low[index]), float(each.high[index])
            found.append(NumberField(len(found), name, low, high, each.part, index))
    return tuple(found)


def _named(numbers: PartNumbers, index: int) -> str:
    path = ".".join(map(str, numbers.part.path))
    return f"field {path}" if numbers.size == 1 else f"field {path}[{index}]"


def observed_fields(
    contract: Contract, agent: AgentId, space: Space[Any]
) -> tuple[NumberField, ...]:
    """The numbers that an agent sees, without its mask."""
    return fields_in(seen_parts(contract, agent, space))


def acted_fields(space: Space[Any]) -> tuple[NumberField, ...]:
    """The numbers of an agent's action: its axes."""
    return fields_in(tuple(parts_of(space)))
