"""Agents that act in turn: who waits keeps what it was shown last."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.adapters.torchrl.copies import Bools, Copies
from gamekeeper.adapters.torchrl.seats import Seats


class Waiting:
    """What each agent of an AEC environment was shown last, and whose turn it is.

    Args:
        copies: of the environment.
        seats: of the agents that are seen.
    """

    def __init__(self, copies: Copies, seats: list[Seats]) -> None:
        self._copies, self._seats = copies, seats
        self._last = {each.name: [self._blank(each, part) for part in each.seen] for each in seats}
        self._was_shown: Bools = np.zeros((copies.num_envs, len(copies.agents)), bool)

    def _blank(self, each: Seats, part: Any) -> NDArray[Any]:
        g, _ = each.runs[0]
        one = self._copies.arrays[f"obs.{g}.{part.place}"]
        return np.zeros((len(one), each.size, *one.shape[1:]), one.dtype)

    def clear(self, which: Bools) -> None:
        """Nobody has been shown anything in these copies."""
        self._was_shown[which] = False
        for arrays in self._last.values():
            for array in arrays:
                array[which] = 0

    def look(self) -> None:
        """Keeps what is shown to who is in turn."""
        arrays, copies = self._copies.arrays, np.flatnonzero(~self._copies.over)
        self._was_shown[copies, arrays["turn"][copies]] = True
        for each in self._seats:
            for rows, slots, g in self._turns(each):
                for part, last in zip(each.seen, self._last[each.name], strict=True):
                    last[rows, slots] = arrays[f"obs.{g}.{part.place}"][rows]

    def _turns(self, each: Seats) -> Any:
        """Copies in which one of the group is in turn, its places, and their group there."""
        turn = self._copies.arrays["turn"]
        slots = np.where(self._copies.over, -1, each.slot_of[turn])
        for g, _ in each.runs:
            columns = self._copies.groups[g].columns
            rows = np.flatnonzero((slots >= 0) & (columns.start <= turn) & (turn < columns.stop))
            yield rows, slots[rows], g

    def in_turn(self) -> Bools:
        """[copy, column], who acts next."""
        found = np.zeros_like(self._was_shown)
        copies = np.flatnonzero(~self._copies.over)
        found[copies, self._copies.arrays["turn"][copies]] = True
        return found

    def shown(self, each: Seats) -> tuple[list[NDArray[Any]], Bools]:
        """What the group's agents were shown last; who of all agents was shown anything."""
        return [array.copy() for array in self._last[each.name]], self._was_shown

    def masks(self, each: Seats) -> Bools:
        """[copy, place, action], what who is in turn may do."""
        legal = np.zeros((self._copies.num_envs, each.size, each.flags), bool)
        for rows, slots, g in self._turns(each):
            legal[rows, slots] = self._copies.arrays[f"mask.{g}"][rows].astype(bool)
        return legal

    def put(
        self, actions: dict[tuple[int, int], NDArray[Any]], each: Seats, place: int, given: Any
    ) -> None:
        """Puts the action of who is in turn into the array of its group."""
        for rows, slots, g in self._turns(each):
            actions[g, place][rows] = given[rows, slots]
