"""Parts of an observation or action, and their numbers, read and written in their own types."""

import contextlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    MultiBinary,
    MultiDiscrete,
    Sequence,
    Space,
    Text,
    Tuple,
)
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.episodes.message_field import MessageField, message_field, path_in
from gamekeeper.errors import ContractError
from gamekeeper.interface.capture import AgentId

MISSING: Final = object()
"""In place of a part that a value hasn't got."""
USUAL_MASK: Final = "action_mask"

Path = tuple[Any, ...]
Floats = NDArray[np.float64]

WIDEST: Final = 1e9
"""Bounds that are further apart are none: the ends of a dtype, as many spaces have them."""


@dataclass(frozen=True, slots=True)
class ValuePart:
    """One space within another.

    Attributes:
        path: keys of Dict and positions in Tuple spaces that lead there.
        space: what stands there; no Dict and no Tuple.
        numbers: which of a Box's numbers are meant, in C order; None: all.
    """

    path: Path
    space: Space[Any]
    numbers: slice | tuple[int, ...] | None = None

    def of(self, whole: Any) -> Any:
        """Value at the path, or MISSING."""
        for key in self.path:
            try:
                whole = whole[key]
            except (KeyError, IndexError, TypeError):
                return MISSING
        return whole

    def put(self, whole: Any, value: Any) -> Any:
        """The same with another value there; what was given stays as it was."""
        return _put(whole, self.path, value)

    def __str__(self) -> str:
        """As a contract names it, where its numbers stand in a row."""
        numbers = self.numbers if isinstance(self.numbers, slice) else None
        return str(MessageField("observation", tuple(map(str, self.path)), numbers))


def _put(whole: Any, path: Path, value: Any) -> Any:
    if not path:
        return value
    key, *rest = path
    inner = _put(whole[key], tuple(rest), value)
    if isinstance(whole, tuple | list):
        items = [*whole[:key], inner, *whole[key + 1 :]]
        return tuple(items) if isinstance(whole, tuple) else items
    return {**whole, key: inner}


def parts_of(space: Space[Any], path: Path = ()) -> Iterator[ValuePart]:
    """The parts of a space that have no parts of their own."""
    if isinstance(space, Dict):
        for key, inner in space.spaces.items():
            yield from parts_of(inner, (*path, key))
    elif isinstance(space, Tuple):
        for place, inner in enumerate(space.spaces):
            yield from parts_of(inner, (*path, place))
    else:
        yield ValuePart(path, space)


def mask_path(contract: Contract, agent: AgentId, space: Space[Any]) -> Path | None:
    """Path of an agent's mask in its observation; None: not in it."""
    place = contract.mask_of(agent)
    if place is None:
        usual = isinstance(space, Dict) and USUAL_MASK in space.spaces
        return (USUAL_MASK,) if usual else None
    side, *keys = place.split(".")
    return path_in(space, MessageField("observation", tuple(keys))) if side[:3] == "obs" else None


def seen_parts(contract: Contract, agent: AgentId, space: Space[Any]) -> tuple[ValuePart, ...]:
    """All that an agent sees but its mask, which is a rule of the game and no sense."""
    mask = mask_path(contract, agent, space)
    found = parts_of(space)
    return tuple(part for part in found if mask is None or part.path[: len(mask)] != mask)


def named_parts(
    name: str, space: Space[Any], parts: tuple[ValuePart, ...]
) -> tuple[ValuePart, ...]:
    """Those of an observation's parts that a name means, as a contract names message fields.

    Raises:
        ContractError: the name isn't of this form.
    """
    field = message_field(name)
    path = path_in(space, field) if field.side == "observation" else None
    if path is None:
        return ()
    found = [part for part in parts if part.path[: len(path)] == path]
    if field.numbers is None:
        return tuple(found)
    some = [ValuePart(part.path, part.space, field.numbers) for part in found]
    return tuple(part for part in some if _places(part))


def message_parts(contract: Contract, agent: AgentId, space: Space[Any]) -> tuple[ValuePart, ...]:
    """Those parts of what an agent sees that are declared to carry messages.

    A contract may also say it in words; what names no field is passed over.
    """
    role = contract.roles.get(contract.role_of(agent) or "")
    parts, names = seen_parts(contract, agent, space), () if role is None else role.messages or ()
    found: list[ValuePart] = []
    for name in names:
        with contextlib.suppress(ContractError):
            found += named_parts(name, space, parts)
    return tuple({(each.path, str(each.numbers)): each for each in found}.values())


def joined(parts: Iterable[ValuePart]) -> tuple[ValuePart, ...]:
    """The parts, those numbers that stand in one array as one: they are read and written once."""
    found: dict[Path, ValuePart] = {}
    for part in parts:
        other = found.get(part.path)
        if other is None or part.numbers is None:
            found[part.path] = part
        elif other.numbers is not None:
            places = {*_places(other), *_places(part)}
            found[part.path] = ValuePart(part.path, part.space, tuple(sorted(places)))
    return tuple(found.values())


def _places(part: ValuePart) -> tuple[int, ...]:
    if not isinstance(part.numbers, slice):
        return part.numbers or ()
    return tuple(range(math.prod(part.space.shape or ()))[part.numbers])


def blank_of_rare(space: Space[Any], value: Any) -> Any:
    """Empty value of a space without numbers: no text, no items; other values stay."""
    if isinstance(space, Text):
        return min(space.character_list) * space.min_length
    if isinstance(space, Sequence) and not space.stack:
        return ()
    return value


def scalar_like(like: Any, number: Any) -> Any:
    """A number of the very type of another."""
    if isinstance(like, np.generic):
        return like.dtype.type(number)
    return type(like)(number) if isinstance(like, bool | int | float) else number


class PartNumbers:
    """Reads the numbers of a part out of a value, and gives the value with others in their place.

    Attributes:
        part: where they stand.
        size: how many there are.
        low: [size] the least that the space allows, minus infinity where nothing is declared.
        high: [size] the greatest, likewise.
        width: [size] how far they can lie apart: as declared, or, where no bounds are, how far
            apart those that were read so far have been, 0 counted as one of them.
    """

    def __init__(self, part: ValuePart) -> None:
        low, high = _bounds(part.space)
        self.part = part
        place = slice(None) if part.numbers is None else part.numbers
        self._place = list(place) if isinstance(place, tuple) else place
        self.low, self.high = low[self._place], high[self._place]
        self.size = int(self.low.size)
        with np.errstate(over="ignore", invalid="ignore"):
            span = self.high - self.low
        self.is_bounded = np.isfinite(span) & (span <= WIDEST)
        self.width = np.where(self.is_bounded, span, 0.0)
        self._least, self._most = np.zeros(self.size), np.zeros(self.size)
        self._is_all_bounded = bool(self.is_bounded.all())

    def read(self, whole: Any) -> Floats | None:
        """[size] the numbers; None where the value hasn't the declared form."""
        value = self.part.of(whole)
        if not isinstance(value, np.ndarray | np.generic | int | float | list):
            return None
        try:
            array = np.asarray(value)
        except ValueError:  # a list of lists that have different lengths
            return None
        if array.shape != self.part.space.shape or array.dtype.kind not in "biuf":
            return None
        found = array.reshape(-1)[self._place].astype(np.float64)
        if not self._is_all_bounded:
            self._widen(found)
        return found

    def write(self, whole: Any, numbers: Floats) -> Any:
        """The value with these numbers, rounded where they are whole, kept in the space."""
        value = self.part.of(whole)
        kept = np.minimum(np.maximum(numbers, self.low), self.high)  # np.clip takes twice as long
        array = np.array(value, order="C")
        if array.dtype.kind in "biu":
            kept = np.rint(kept)
        array.reshape(-1)[self._place] = kept.astype(array.dtype)
        if isinstance(value, np.ndarray):
            return self.part.put(whole, array)
        return self.part.put(
            whole, array.tolist() if isinstance(value, list) else scalar_like(value, kept[0])
        )

    def blank(self) -> Floats:
        """[size] zeros, or what the space allows that is nearest to them."""
        return np.clip(np.zeros(self.size), self.low, self.high)

    def _widen(self, found: Floats) -> None:
        finite = np.where(np.isfinite(found), found, 0.0)
        self._least = np.minimum(self._least, finite)
        self._most = np.maximum(self._most, finite)
        self.width = np.where(self.is_bounded, self.width, self._most - self._least)


def _bounds(space: Space[Any]) -> tuple[Floats, Floats]:
    if isinstance(space, Box):
        return _flat(space.low), _flat(space.high)
    if isinstance(space, Discrete):
        return _flat(space.start), _flat(space.start + space.n - 1)
    if isinstance(space, MultiDiscrete):
        return _flat(space.start), _flat(space.start + space.nvec - 1)
    count = int(np.prod(space.shape or ()))
    return np.zeros(count), np.ones(count)


def _flat(numbers: Any) -> Floats:
    return np.asarray(numbers).reshape(-1).astype(np.float64)


def are_numbers(space: Space[Any]) -> bool:
    """Tells whether the values of a space are numbers."""
    return isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete)


def numbers_of(parts: Iterable[ValuePart]) -> list[PartNumbers]:
    """Those parts that are numbers, and have any."""
    found = [PartNumbers(part) for part in parts if are_numbers(part.space)]
    return [each for each in found if each.size]
