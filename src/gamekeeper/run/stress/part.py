"""Parts of an observation or action: where one stands, and the same value with another there."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Dict, Sequence, Space, Text, Tuple

from gamekeeper.core.contract import Contract
from gamekeeper.core.message_field import MessageField, message_field, path_in
from gamekeeper.errors import ContractError
from gamekeeper.game.door import AgentId

MISSING: Final = object()
"""In place of a part that a value hasn't got."""
USUAL_MASK: Final = "action_mask"

Path = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Part:
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
        """What stands there, or MISSING."""
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


def parts_of(space: Space[Any], path: Path = ()) -> Iterator[Part]:
    """The parts of a space that have no parts of their own."""
    if isinstance(space, Dict):
        for key, inner in space.spaces.items():
            yield from parts_of(inner, (*path, key))
    elif isinstance(space, Tuple):
        for place, inner in enumerate(space.spaces):
            yield from parts_of(inner, (*path, place))
    else:
        yield Part(path, space)


def mask_path(contract: Contract, agent: AgentId, space: Space[Any]) -> Path | None:
    """Where an agent's mask stands in its observation; None: not in it."""
    place = contract.mask_of(agent)
    if place is None:
        usual = isinstance(space, Dict) and USUAL_MASK in space.spaces
        return (USUAL_MASK,) if usual else None
    side, *keys = place.split(".")
    return path_in(space, MessageField("observation", tuple(keys))) if side[:3] == "obs" else None


def seen_parts(contract: Contract, agent: AgentId, space: Space[Any]) -> tuple[Part, ...]:
    """All that an agent sees but its mask, which is a rule of the game and no sense."""
    mask = mask_path(contract, agent, space)
    found = parts_of(space)
    return tuple(part for part in found if mask is None or part.path[: len(mask)] != mask)


def named_parts(name: str, space: Space[Any], parts: tuple[Part, ...]) -> tuple[Part, ...]:
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
    some = [Part(part.path, part.space, field.numbers) for part in found]
    return tuple(part for part in some if _places(part))


def message_parts(contract: Contract, agent: AgentId, space: Space[Any]) -> tuple[Part, ...]:
    """Those parts of what an agent sees that are declared to carry messages.

    A contract may also say it in words; what names no field is passed over.
    """
    role = contract.roles.get(contract.role_of(agent) or "")
    parts, names = seen_parts(contract, agent, space), () if role is None else role.messages or ()
    found: list[Part] = []
    for name in names:
        with contextlib.suppress(ContractError):
            found += named_parts(name, space, parts)
    return tuple({(each.path, str(each.numbers)): each for each in found}.values())


def joined(parts: Iterable[Part]) -> tuple[Part, ...]:
    """The parts, those numbers that stand in one array as one: they are read and written once."""
    found: dict[Path, Part] = {}
    for part in parts:
        other = found.get(part.path)
        if other is None or part.numbers is None:
            found[part.path] = part
        elif other.numbers is not None:
            places = {*_places(other), *_places(part)}
            found[part.path] = Part(part.path, part.space, tuple(sorted(places)))
    return tuple(found.values())


def _places(part: Part) -> tuple[int, ...]:
    if not isinstance(part.numbers, slice):
        return part.numbers or ()
    return tuple(range(math.prod(part.space.shape or ()))[part.numbers])


def blank_of_rare(space: Space[Any], value: Any) -> Any:
    """Nothing to be seen in a space without numbers: no text, no items; other values stay."""
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
