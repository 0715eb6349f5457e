"""What is as a PettingZoo environment should give it, and how a row keeps what isn't."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from gamekeeper.core.canon import to_json, type_name

WHOLES: Final = frozenset({int, *(np.dtype(code).type for code in "bhilqBHILQ")})
# what PettingZoo environments pay in; a bool or a text is no reward
FLOATS: Final = frozenset({float, *(np.dtype(code).type for code in "efd")})
REALS: Final = WHOLES | FLOATS
BOOLS: Final = frozenset({bool, np.bool_})
EXACT: Final = 1 << 53  # beyond it a whole number has no exact float64


class Missing:
    """Stands for a key that a dictionary should have had."""


MISSING: Final = Missing()


def odd(field: str, value: object) -> str:
    """One entry of a row's `odd` object: the value as it was, with its type."""
    if value is MISSING:
        return f'"{field}":{{"type":"missing"}}'
    return f'"{field}":{{"type":{to_json(type_name(value))},"value":{to_json(value)}}}'


def odd_type(field: str, value: object) -> str:
    """The same for a value that stands in its column; only its type is another than usual."""
    return f'"{field}":{{"type":{to_json(type_name(value))}}}'


def reward_of(reward: Any) -> float | None:
    """`reward` if it is a real number that a float64 holds exactly, else None."""
    kind = reward.__class__
    if kind not in REALS or (kind in WHOLES and not -EXACT <= reward <= EXACT):
        return None
    return reward  # type: ignore[no-any-return]  # one of REALS


def flag_of(flag: Any, field: str, entries: list[str]) -> Any:
    """`flag` if it is a bool; else None, and the value as it was goes to `entries`."""
    if flag.__class__ in BOOLS:
        return flag
    entries.append(odd(field, flag))
    return None


def type_name_of(kind: type) -> str:
    """`int`, `numpy.int64`: the name of a type as evidence spells it."""
    return kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"
