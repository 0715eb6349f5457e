"""Delta debugging: the least of several things that together still show something. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeVar

Item = TypeVar("Item")
Shows = Callable[[Sequence[Item]], bool]
"""Test of some of the things, in their order."""


def least_set(items: Sequence[Item], shows: Shows[Item]) -> tuple[Item, ...]:
    """The items from which none can be taken without `shows` turning false.

    First by growing a prefix, so that the likeliest should stand first, then by delta debugging
    inside it: halves, their complements, then ever smaller parts.

    Args:
        items: all of them together are taken to show it.
        shows: asked for subsets only.
    Source: Zeller & Hildebrandt 2002, "Simplifying and isolating failure-inducing input" (ddmin).
    """
    size = 1
    while size < len(items) and not shows(items[:size]):
        size *= 2
    left, parts = list(items[:size]), 2
    while len(left) >= 2:
        smaller = _smaller(left, parts, shows)
        if smaller is not None:
            left, parts = smaller
        elif parts >= len(left):
            break
        else:
            parts = min(2 * parts, len(left))
    return tuple(left)


def _smaller(items: list[Item], parts: int, shows: Shows[Item]) -> tuple[list[Item], int] | None:
    """A part that shows it, or what is left without a part; and into how many to divide it."""
    edges = [len(items) * number // parts for number in range(parts + 1)]
    spans = list(pairwise(edges))
    for begin, end in spans:
        if shows(items[begin:end]):
            return items[begin:end], 2
    for begin, end in spans if parts > 2 else ():  # of two, what is left is the other one
        rest = items[:begin] + items[end:]
        if shows(rest):
            return rest, max(parts - 1, 2)  # one part fewer, of the same size
    return None
