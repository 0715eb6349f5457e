"""The numbers of a foraging task: bounds of levels, what they come to, the record rules read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from gamekeeper.errors import SpecError

HIGHEST: Final = 1000
"""The highest level that may be asked for: sums of many players' stay exact."""
WIDEST: Final = 1 << 14
"""The longest side of a field: its rows fit into 16 bits."""
AHEAD: Final = ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1), (0, 0))
"""Rows and columns that each action moves by."""
Levels: TypeAlias = int | Sequence[int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A field, who is on it, and how it pays.

    Attributes:
        players, foods: how many.
        size: rows and columns.
        sight: how far players see, in rows and columns.
        strength, worth: [players, 2], [foods, 2] bounds of levels.
        is_coop: food has its highest level.
        is_normalized: an episode pays 1 at most.
        shows_levels: players see the levels of players.
        penalty: of loading in vain, in reward units.
    Raises:
        SpecError: a number is out of its range.
    """

    players: int
    foods: int
    size: tuple[int, int]
    sight: int
    strength: NDArray[np.int64]
    worth: NDArray[np.int64]
    is_coop: bool
    is_normalized: bool
    shows_levels: bool
    penalty: float

    def __post_init__(self) -> None:
        for side in self.size:
            within("field_size", side, 3, WIDEST)
        within("sight", self.sight, 1, WIDEST)
        within("players", self.players, 1, self.size[0] * self.size[1])
        within("max_num_food", self.foods, 1, self.size[0] * self.size[1])
        least = int(self._three()[0])
        if not self.is_coop and ((self.worth[:, 1] == 0) & (self.worth[:, 0] > least)).any():
            raise SpecError(
                "food may be stronger than the three weakest players together",
                where="min_food_level",
                expected=f"{least} at most, or a max_food_level",
                seen=str(self.worth[:, 0].tolist()),
            )

    @property
    def best(self) -> int:
        """The highest level that food can have."""
        return int(np.where(self.worth[:, 1] == 0, self._three()[1], self.worth[:, 1]).max())

    @property
    def strongest(self) -> int:
        """The highest level that a player can have."""
        return int(self.strength[:, 1].max())

    def observed(self) -> Box:
        """The observation space of a player (R7)."""
        last = [side - 1 for side in self.size]
        low, high = [-1, -1, 0] * self.foods, [*last, self.best] * self.foods
        if self.shows_levels:
            low, high = (
                low + [-1, -1, 0] * self.players,
                high + [*last, self.strongest] * self.players,
            )
        else:
            low, high = low + [-1, -1] * self.players, high + last * self.players
        return Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)

    def tables(self) -> NDArray[Any]:
        """The record that rules read."""
        fields = np.dtype(
            [
                ("ahead", "i1", (6, 2)), ("player_levels", "i4", self.strength.shape),
                ("food_levels", "i4", self.worth.shape), ("sight", "i4"), ("penalty", "f8"),
                ("coop", "i1"), ("normalized", "i1"), ("levels", "i1"),
            ],
            align=True,
        )  # fmt: skip
        tables = np.zeros(1, fields)
        tables[0] = (
            AHEAD, self.strength, self.worth, self.sight, self.penalty, self.is_coop,
            self.is_normalized, self.shows_levels,
        )  # fmt: skip
        return tables

    def _three(self) -> Any:
        """The least and the most that the three weakest players have together."""
        return np.sort(self.strength, axis=0)[:3].sum(axis=0)


def within(name: str, number: object, low: int, high: int) -> None:
    """A whole number lies between its bounds.

    Raises:
        SpecError: it doesn't.
    """
    if not isinstance(number, int | np.integer) or not low <= number <= high:
        raise SpecError(
            f"{name} is no number that foraging can have",
            where=name,
            expected=f"a whole number from {low} to {high}",
            seen=repr(number),
        )


def levels(whose: str, low: Levels, high: Levels | None, count: int) -> NDArray[np.int64]:
    """[count, 2] lower and upper bounds; an upper bound of 0 is found as the episode begins.

    Args:
        whose: `player` or `food`, for errors.
        low, high: for all, or for each.
        count: how many there are.
    Raises:
        SpecError: a bound is missing, out of its range, or the lower above the upper.
    """
    bounds = []
    for name, given in ((f"min_{whose}_level", low), (f"max_{whose}_level", high)):
        each = [given] * count if given is None or isinstance(given, int) else list(given)
        if len(each) != count:
            raise SpecError(
                f"{name} isn't a level for each", where=name, expected=f"{count} levels",
                seen=repr(given),
            )  # fmt: skip
        for level in each:
            if level is not None:
                within(name, level, 1, HIGHEST)
        bounds.append([level or 0 for level in each])
    if high is not None and any(a > b for a, b in zip(*bounds, strict=True)):
        raise SpecError(
            "a lowest level is above the highest",
            where=f"min_{whose}_level",
            expected=f"{bounds[1]} at most",
            seen=repr(bounds[0]),
        )
    return np.array(bounds).T
