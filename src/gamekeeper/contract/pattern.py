"""Patterns of agent names: `picker_*`, `arm_?`, `robot_[ab]`, as `fnmatch` reads them."""

import re
from fnmatch import fnmatchcase
from typing import Final

Ranges = tuple[tuple[int, int], ...]
"""Code points, as closed intervals; the empty tuple is a character that nothing is."""

EVERY: Final[Ranges] = ((0, 0x10FFFF),)
TOKEN: Final = re.compile(r"\*|\?|\[(!?+)(\]?+[^\]]*)\]|.", re.DOTALL)
"""A star, any one character, a set, or a character that stands for itself."""


def matches(pattern: str, name: str) -> bool:
    """The pattern covers the name, upper and lower case told apart on every platform."""
    return fnmatchcase(name, pattern)


def is_exact(pattern: str) -> bool:
    """The pattern covers one name only: itself."""
    return not set(pattern) & set("*?[")


def exact(name: str) -> str:
    """The pattern that covers this name only."""
    return re.sub(r"([*?[])", r"[\1]", name)


def overlap(one: str, other: str) -> bool:
    """Some name is covered by both patterns.

    Walks the product of the two patterns' states, so it is exact and never slower than the
    product of their lengths.
    """
    left, right = _tokens(one), _tokens(other)
    reached, todo = {(0, 0)}, [(0, 0)]
    while todo:
        i, j = todo.pop()
        if i == len(left) and j == len(right):
            return True
        for step in _steps(left, right, i, j):
            if step not in reached:
                reached.add(step)
                todo.append(step)
    return False


def _steps(
    left: list[Ranges | None], right: list[Ranges | None], i: int, j: int
) -> list[tuple[int, int]]:
    """The states that follow (i, j); a star, None, may cover nothing or one character more.

    The end of a pattern is like a set without members: no character leads on from it.
    """
    a = left[i] if i < len(left) else ()
    b = right[j] if j < len(right) else ()
    if a is None:
        return [(i + 1, j), *([(i, j + 1)] if b != () else [])]
    if b is None:
        return [(i, j + 1), *([(i + 1, j)] if a != () else [])]
    meet = any(low <= high2 and low2 <= high for low, high in a for low2, high2 in b)
    return [(i + 1, j + 1)] if meet else []


def _tokens(pattern: str) -> list[Ranges | None]:
    return [_token(found) for found in TOKEN.finditer(pattern)]


def _token(found: re.Match[str]) -> Ranges | None:
    text = found.group()
    if text == "*":
        return None
    if text == "?":
        return EVERY
    if len(text) == 1:
        return ((ord(text), ord(text)),)
    members = _members(found.group(2))
    return _complement(members) if found.group(1) else members


def _members(body: str) -> Ranges:
    """The characters of a set; a range that runs backwards holds none, as in `fnmatch`."""
    ranges, at = [], 0
    while at < len(body):
        if at + 2 < len(body) and body[at + 1] == "-":
            low, high, at = ord(body[at]), ord(body[at + 2]), at + 3
        else:
            low, high, at = ord(body[at]), ord(body[at]), at + 1
        if low <= high:
            ranges.append((low, high))
    return tuple(ranges)


def _complement(members: Ranges) -> Ranges:
    ranges, start = [], 0
    for low, high in sorted(members):
        if start < low:
            ranges.append((start, low - 1))
        start = max(start, high + 1)
    return (*ranges, (start, EVERY[0][1])) if start <= EVERY[0][1] else tuple(ranges)
