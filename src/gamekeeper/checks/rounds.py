"""Rounds of an episode: its ticks, and whether turns come in a fixed or rotating order."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final

from gamekeeper.episodes.episode import Episode, Turn

FIXED: Final = "fixed"
ROTATING: Final = "rotating"
OTHER: Final = "other"


def ticks(episode: Episode) -> list[range]:
    """The turns of an episode by ticks: one ends before somebody acts a second time in it.

    The None step of an agent that had ended belongs to the tick before it.
    """
    starts, acted, last = [0], set[str](), -1
    for turn in episode.turns:
        acting = movers(turn)
        if not acted.isdisjoint(acting):
            starts.append(turn.index)
            acted = set()
        acted.update(acting)
        last = turn.index
    return [range(start, end) for start, end in pairwise([*starts, last + 1]) if start < end]


def movers(turn: Turn) -> tuple[str, ...]:
    """Agents that acted at a turn, without one that had ended and stepped with None."""
    return tuple(agent for agent in turn.order if turn.actions.get(agent) is not None)


def orders(episode: Episode) -> list[tuple[str, ...]]:
    """Order of the agents that acted in each tick; the last tick may be cut short."""
    acted = {turn.index: movers(turn) for turn in episode.turns}
    rounds = [tuple(n for k in tick for n in acted.get(k, ())) for tick in ticks(episode)]
    return [each for each in rounds if each]


def kind_of_order(rounds: Iterable[Sequence[str]]) -> str | None:
    """`fixed`, `rotating` (each tick begins with the one after the last one's first), or `other`.

    None where no tick had two agents.
    """
    known = [tuple(each) for each in rounds]
    if all(len(each) < 2 for each in known):
        return None
    fullest = max(known, key=len)
    if all(each == tuple(n for n in fullest if n in each) for each in known):
        return FIXED
    if all(_is_rotation(each, fullest) for each in known) and _moves_on(known, fullest):
        return ROTATING
    return OTHER


def _is_rotation(order: tuple[str, ...], ring: tuple[str, ...]) -> bool:
    if not set(order) <= set(ring):
        return False
    start = ring.index(order[0])
    turned = ring[start:] + ring[:start]
    return order == tuple(name for name in turned if name in order)


def _moves_on(rounds: list[tuple[str, ...]], ring: tuple[str, ...]) -> bool:
    """Tells whether the first of each tick moves by the same number of places."""
    whole = [each for each in rounds if len(each) == len(ring)]
    steps = {(ring.index(two[0]) - ring.index(one[0])) % len(ring) for one, two in pairwise(whole)}
    return len(steps) == 1 and steps != {0}
