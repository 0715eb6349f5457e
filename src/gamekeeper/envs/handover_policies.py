"""Policies that play `handover`: they know what an arm observes, and nothing else.

None of them looks at the mask: it tells the truth, also where an arm's senses are disturbed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from numpy.random import Generator
from numpy.typing import NDArray

RETRACT, REACH, GRASP, RELEASE, WAIT = range(5)
OWN, HOLDS, OTHER, OTHER_HOLDS, SLOT, TRAY, SLOT_AT, EDGE, LEFT = range(9)
"""Places of an observation; see `Handover`."""
UNSEEN: Final = 0
EMPTY: Final = 1
"""What stands for a slot or a hand that is seen empty, and a tray; more is more."""
YIELDS: Final = 0.15
"""Probability a turn that a greedy arm backs out of the shared space where it can do nothing."""


def reference(
    observation: NDArray[Any], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Lets the other go first: an arm waits at the edge until the space is clear and it has work.

    The giver reaches in with a part once the slot is empty, the receiver once something lies in it.
    """
    seen = [int(number) for number in observation]
    return _reference_giver(seen) if agent.startswith("giver") else _reference_receiver(seen)


def greedy(observation: NDArray[Any], agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Reaches in as soon as the space is clear and a part is on its way, and waits in there.

    A receiver that is in before the part keeps the giver out. Where neither can go on, one inside
    backs out by chance (YIELDS).
    """
    seen = [int(number) for number in observation]
    if agent.startswith("giver"):
        return _reference_giver(seen)
    is_coming = seen[SLOT] > EMPTY or seen[TRAY] > EMPTY or seen[OTHER_HOLDS] > EMPTY
    if seen[HOLDS] or not is_coming:
        return _reference_receiver(seen)
    if seen[SLOT] > EMPTY or seen[OWN] <= seen[EDGE]:
        return _on_the_way(seen)
    is_going_back = rng.random() < YIELDS
    return RETRACT if is_going_back else _on_the_way(seen)


def lazy(observation: NDArray[Any], agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Waits, whatever arrives."""
    return WAIT


def _reference_giver(seen: list[int]) -> int:
    """Home, grasp, to the edge, and in once the slot is seen empty."""
    own, at = seen[OWN], seen[SLOT_AT]
    if not seen[HOLDS]:
        if own > 0:
            return RETRACT
        return GRASP if seen[TRAY] > EMPTY else WAIT
    if own < seen[EDGE]:
        return REACH
    if own == seen[EDGE]:
        return REACH if _is_clear(seen) and seen[SLOT] == EMPTY else WAIT
    if own != at:
        return REACH if own < at else RETRACT
    return {EMPTY: RELEASE, UNSEEN: WAIT}.get(seen[SLOT], RETRACT)


def _reference_receiver(seen: list[int]) -> int:
    """To the edge, in once something lies in the slot, and home with it."""
    own = seen[OWN]
    if seen[HOLDS]:
        return RETRACT if own > 0 else RELEASE
    if own >= seen[EDGE] and seen[SLOT] == EMPTY:
        return RETRACT if own > seen[EDGE] else WAIT
    return _on_the_way(seen)


def _on_the_way(seen: list[int]) -> int:
    """An empty hand to the slot, as far as the space is clear, to grasp what is seen there."""
    own, at = seen[OWN], seen[SLOT_AT]
    if own == seen[EDGE] and not _is_clear(seen):
        return WAIT
    if own != at:
        return REACH if own < at else RETRACT
    return GRASP if seen[SLOT] > EMPTY else WAIT


def _is_clear(seen: list[int]) -> bool:
    """The other arm is seen, and outside the shared space."""
    return UNSEEN < seen[OTHER] <= seen[EDGE] + 1
