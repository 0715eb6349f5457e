"""Place of a message, as a contract names it: `observation.word`, `observation[-3:]`."""

import re
from dataclasses import dataclass
from typing import Any, Final, Literal, cast

from gymnasium.spaces import Box, Dict, Space, Tuple

from gamekeeper.errors import ContractError

Side = Literal["observation", "action"]

_FIELD: Final = re.compile(
    r"(?P<path>[^\[\].\s]+(?:\.[^\[\].\s]+)*)"
    r"(?:\[(?:(?P<one>-?\d+)|(?P<first>-?\d+)?:(?P<end>-?\d+)?)\])?"
)


@dataclass(frozen=True, slots=True)
class MessageField:
    """A part of an observation or of an action.

    Attributes:
        side: of which.
        keys: of Dict spaces, and positions in Tuple spaces as digits, from outside inwards; none:
            all of it.
        numbers: which of a Box's numbers, in C order; None: all of them.
    """

    side: Side
    keys: tuple[str, ...] = ()
    numbers: slice | None = None

    def __str__(self) -> str:
        """The field as a contract names it."""
        path = ".".join((self.side, *self.keys))
        if self.numbers is None:
            return path
        first, end = ("" if x is None else x for x in (self.numbers.start, self.numbers.stop))
        return f"{path}[{first}:{end}]"


def message_field(text: str) -> MessageField:
    """The field that a text names.

    Args:
        text: `observation` or `action`, keys after points, and `[first:end]` or `[at]` for some of
            a Box's numbers. Without one of the two words it is a key of the observation.
    Raises:
        ContractError: the text is of another form.
    """
    found = _FIELD.fullmatch(text)
    if found is None:
        raise ContractError(
            "this names no field of an observation or action",
            where="messages",
            expected="observation, observation.KEY, observation[first:end], the same of action",
            actual=repr(text),
            fix="name a key after a point, and numbers of a Box in brackets: observation.word[0:3]",
        )
    side, *keys = found["path"].split(".")
    if side not in ("observation", "action"):
        side, keys = "observation", [side, *keys]
    return MessageField(cast("Side", side), tuple(keys), _numbers(found))


def _numbers(found: re.Match[str]) -> slice | None:
    if found["one"] is not None:
        one = int(found["one"])
        return slice(one, one + 1 or None)
    if "[" not in found[0]:
        return None
    first, end = (None if found[x] is None else int(found[x]) for x in ("first", "end"))
    return slice(first, end)


def path_in(space: Space[Any], field: MessageField) -> tuple[Any, ...] | None:
    """The keys and positions that lead to a field within a space; None: the space hasn't got it."""
    path: list[Any] = []
    for key in field.keys:
        if isinstance(space, Dict):
            own = next((each for each in space.spaces if str(each) == key), None)
            if own is None:
                return None
            path.append(own)
            space = space.spaces[own]
        elif isinstance(space, Tuple) and key.isdecimal() and int(key) < len(space.spaces):
            path.append(int(key))
            space = space.spaces[int(key)]
        else:
            return None
    return tuple(path) if field.numbers is None or isinstance(space, Box) else None
