"""Bounds of a space's nesting: what is within them can be taken apart, written and read again."""

from collections.abc import Iterable
from typing import Any, Final

from gymnasium.spaces import Dict, Graph, OneOf, Sequence, Space, Tuple

from gamekeeper.errors import EnvError

MOST_DEEP: Final = 64
"""Spaces within spaces."""
MOST_PARTS: Final = 65_536
"""Spaces in one space; parts that share parts can be exponentially many, or endless."""


def check_extent(space: Space[Any]) -> None:
    """Refuses a space that is nested deeper, or has more parts, than a run can hold.

    Raises:
        EnvError: it is, or has.
    """
    level, count, depth = [space], 0, 0
    while level:
        count, depth = count + len(level), depth + 1
        if depth > MOST_DEEP or count > MOST_PARTS:
            raise EnvError(
                "a space of the environment has no end that can be recorded",
                where="observation_space, action_space or state_space",
                expected=f"at most {MOST_DEEP} spaces within each other, {MOST_PARTS:,} in all",
                actual=f"{depth} within each other, {count:,} up to there",
                fix="flatten the space (gymnasium.spaces.utils.flatten_space)",
            )
        level = [part for each in level for part in _parts(each)]


def _parts(space: Space[Any]) -> Iterable[Any]:
    if isinstance(space, Dict):
        return list(space.spaces.values())
    if isinstance(space, Tuple | OneOf):
        return list(space.spaces)
    if isinstance(space, Sequence):
        return [space.feature_space]
    if isinstance(space, Graph):
        return [part for part in (space.node_space, space.edge_space) if part is not None]
    return []
