"""The rules of `foraging`, R1 to R9 of its docstring, over one copy's state."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.kernels import draws
from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.tasks.arguments import check_whole

NOTHING, NORTH, SOUTH, WEST, EAST, LOAD = range(6)
FOOD, PENALTY = range(2)
CLEARED: Final = 1
"""Number of this ending, from 1."""
ATTEMPTS: Final = 1000
"""Cells drawn for food in an episode. Source: `ForagingEnv.spawn_food`."""
WALL: Final = -1


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Walls around the field, then players, then food (R1, R2)."""
    rows, columns = s.grid.shape[0] - 2, s.grid.shape[1] - 2
    for r in range(rows + 2):
        s.grid[r, 0] = WALL
        s.grid[r, columns + 1] = WALL
    for c in range(columns + 2):
        s.grid[0, c] = WALL
        s.grid[rows + 1, c] = WALL
    deal(s, s.to_row)
    for i in range(len(s.row)):
        r = 1 + draws.integers(s, rows)
        c = 1 + draws.integers(s, columns)
        while has_player(s, r, c, i):
            r = 1 + draws.integers(s, rows)
            c = 1 + draws.integers(s, columns)
        s.row[i] = r
        s.column[i] = c
        low, high = t.player_levels[s.to_row[i], 0], t.player_levels[s.to_row[i], 1]
        s.level[i] = low + draws.integers(s, high - low + 1)
    for i in range(len(s.row)):
        s.to_row[i] = s.row[i]
        s.to_column[i] = s.column[i]
    grow(s, t, rows, columns)


@rule
def deal(s, places):  # type: ignore[no-untyped-def]  # likewise
    """Writes the numbers from 0 in random order; as `Stream.shuffle`."""
    for i in range(len(places)):
        places[i] = i
    for i in range(len(places) - 1, 0, -1):
        j = draws.integers(s, i + 1)
        places[i], places[j] = places[j], places[i]


@rule
def has_player(s, r, c, count):  # type: ignore[no-untyped-def]  # likewise
    """Tells whether one of the first `count` players stands there."""
    for i in range(count):  # noqa: SIM110  # a rule has no generators
        if s.row[i] == r and s.column[i] == c:
            return True
    return False


@rule
def grow(s, t, rows, columns):  # type: ignore[no-untyped-def]  # likewise
    """Puts down the food, sorted by cell (R2)."""
    highest = three_lowest(s)
    deal(s, s.dealt)
    count = 0
    for _ in range(ATTEMPTS):
        if count == len(s.worth):
            break
        r = 2 + draws.integers(s, rows - 2)
        c = 2 + draws.integers(s, columns - 2)
        if not is_free(s, r, c):
            continue
        low, high = t.food_levels[s.dealt[count], 0], t.food_levels[s.dealt[count], 1]
        if high == 0:
            high = highest
        if t.coop:
            low = high
        worth = low
        if low != high:
            worth = low + draws.integers(s, high - low + 1)
        k = count
        while k > 0 and (s.food_row[k - 1], s.food_column[k - 1]) > (r, c):
            put(s, k, s.food_row[k - 1], s.food_column[k - 1], s.worth[k - 1])
            k -= 1
        put(s, k, r, c, worth)
        s.spawned += worth
        count += 1
    for k in range(len(s.dealt)):
        s.dealt[k] = 0
    s.left = count


@rule
def put(s, k, r, c, worth):  # type: ignore[no-untyped-def]  # likewise
    """Food number k is there."""
    s.food_row[k] = r
    s.food_column[k] = c
    s.worth[k] = worth
    s.grid[r, c] = k + 1


@rule
def three_lowest(s):  # type: ignore[no-untyped-def]  # likewise
    """The sum of the three lowest levels of players; of all, where there are fewer."""
    total = 0
    for i in range(len(s.level)):
        lower = 0
        for j in range(len(s.level)):
            if s.level[j] < s.level[i] or (s.level[j] == s.level[i] and j < i):
                lower += 1
        if lower < 3:
            total += s.level[i]
    return total


@rule
def is_free(s, r, c):  # type: ignore[no-untyped-def]  # likewise
    """Tells whether food may lie there (R2); walls are as good as nothing."""
    for y in range(r - 1, r + 2):
        for x in range(c - 1, c + 2):
            if s.grid[y, x] > 0:
                return False
    far = max(s.grid[r - 2, c], s.grid[r + 2, c], s.grid[r, c - 2], s.grid[r, c + 2])
    return far <= 0 and not has_player(s, r, c, len(s.row))


@rule
def step(s, t, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """A tick: moves, then food (R3 to R6, R8)."""
    count = len(s.row)
    loading = 0
    for i in range(count):
        if actions[i] == LOAD:
            s.loads[i] = 1
            loading += 1
        elif actions[i] != NOTHING:
            r = s.row[i] + t.ahead[actions[i], 0]
            c = s.column[i] + t.ahead[actions[i], 1]
            if s.grid[r, c] == 0:
                s.to_row[i] = r
                s.to_column[i] = c
    for i in range(count):
        is_alone = True
        for j in range(count):
            if j != i and s.to_row[j] == s.to_row[i] and s.to_column[j] == s.to_column[i]:
                is_alone = False
        if is_alone:
            s.row[i] = s.to_row[i]
            s.column[i] = s.to_column[i]
    for i in range(count):
        s.to_row[i] = s.row[i]
        s.to_column[i] = s.column[i]
    if loading > 0:
        for i in range(count):
            if s.loads[i] != 0:
                k = beside(s, i)
                s.loads[i] = k >= 0
        for i in range(count):
            if s.loads[i] != 0:
                load(s, t, beside(s, i), rewards)
    if s.left == 0:
        for i in range(count):
            terminated[i] = True
            s.ending[i] = CLEARED


@rule
def beside(s, i):  # type: ignore[no-untyped-def]  # likewise
    """The food beside player i: the first of north, south, west, east; -1 where there is none."""
    r, c = s.row[i], s.column[i]
    if s.grid[r - 1, c] > 0:
        return s.grid[r - 1, c] - 1
    if s.grid[r + 1, c] > 0:
        return s.grid[r + 1, c] - 1
    if s.grid[r, c - 1] > 0:
        return s.grid[r, c - 1] - 1
    return max(s.grid[r, c + 1], 0) - 1


@rule
def loads_it(s, i, k):  # type: ignore[no-untyped-def]  # likewise
    """Tells whether player i loads food k, beside which it stands."""
    distance = abs(s.row[i] - s.food_row[k]) + abs(s.column[i] - s.food_column[k])
    return s.loads[i] != 0 and distance == 1


@rule
def load(s, t, k, rewards):  # type: ignore[no-untyped-def]  # likewise
    """All that load food k do it together, and are done (R5, R6)."""
    strength = 0
    for i in range(len(s.row)):
        if loads_it(s, i, k):
            strength += s.level[i]
    is_enough = strength >= s.worth[k]
    for i in range(len(s.row)):
        if loads_it(s, i, k):
            s.loads[i] = 0
            if not is_enough:
                rewards[i, PENALTY] -= t.penalty
            elif t.normalized:
                rewards[i, FOOD] = s.level[i] * s.worth[k] / (strength * s.spawned)
            else:
                rewards[i, FOOD] = s.level[i] * s.worth[k]
    if is_enough:
        s.grid[s.food_row[k], s.food_column[k]] = 0
        s.worth[k] = 0
        s.left -= 1


@rule
def observe(s, t, obs):  # type: ignore[no-untyped-def]  # likewise
    """Food, itself, the others (R7)."""
    foods, count = len(s.worth), len(s.row)
    for i in range(count):
        top, left = max(s.row[i] - t.sight, 1), max(s.column[i] - t.sight, 1)
        low, right = s.row[i] + t.sight, s.column[i] + t.sight
        at = 0
        for k in range(foods):
            r, c = s.food_row[k], s.food_column[k]
            if s.worth[k] > 0 and top <= r <= low and left <= c <= right:
                obs[i, at] = r - top
                obs[i, at + 1] = c - left
                obs[i, at + 2] = s.worth[k]
                at += 3
        while at < 3 * foods:
            obs[i, at] = -1
            obs[i, at + 1] = -1
            obs[i, at + 2] = 0
            at += 3
        at = show(s, t, obs, i, at, i, top, left)
        for j in range(count):
            y, x = s.row[j] - top, s.column[j] - left
            if j != i and 0 <= y <= 2 * t.sight and 0 <= x <= 2 * t.sight:
                at = show(s, t, obs, i, at, j, top, left)
        while at < obs.shape[1]:
            obs[i, at] = -1
            obs[i, at + 1] = -1
            at += 2
            if t.levels:
                obs[i, at] = 0
                at += 1


@rule
def show(s, t, obs, i, at, j, top, left):  # type: ignore[no-untyped-def]  # likewise
    """Writes what player i sees of player j; returns where the next one stands."""
    obs[i, at] = s.row[j] - top
    obs[i, at + 1] = s.column[j] - left
    if not t.levels:
        return at + 2
    obs[i, at + 2] = s.level[j]
    return at + 3


@rule
def inform(s, t, infos):  # type: ignore[no-untyped-def]  # likewise
    """Number of foods left, and of those that observations have room for, before the players."""
    for i in range(len(s.row)):
        infos[i].left = s.left
        infos[i].foods = len(s.worth)


@rule
def overview(s, t, state):  # type: ignore[no-untyped-def]  # likewise
    """(row, column, level) of each player and of each food; level 0: eaten."""
    count = len(s.row)
    for i in range(count):
        state[i, 0] = s.row[i] - 1
        state[i, 1] = s.column[i] - 1
        state[i, 2] = s.level[i]
    for k in range(len(s.worth)):
        state[count + k, 0] = max(s.food_row[k] - 1, 0)
        state[count + k, 1] = max(s.food_column[k] - 1, 0)
        state[count + k, 2] = s.worth[k]


HIGHEST: Final = 1000
"""The highest level that may be asked for: sums of many players' stay exact."""
WIDEST: Final = 1 << 14
"""The longest side of a field: its rows fit into 16 bits."""
AHEAD: Final = ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1), (0, 0))
"""Rows and columns that each action moves by."""
Levels: TypeAlias = int | Sequence[int]


@dataclass(frozen=True, slots=True, kw_only=True)
class FoodField:
    """A field, who is on it, and how it pays; see `Foraging`.

    Attributes:
        strength, worth: [players, 2], [foods, 2] bounds of levels.
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
            check_whole("field_size", side, 3, WIDEST)
        check_whole("sight", self.sight, 1, WIDEST)
        check_whole("players", self.players, 1, self.size[0] * self.size[1])
        check_whole("max_num_food", self.foods, 1, self.size[0] * self.size[1])
        least = int(self._three()[0])
        if not self.is_coop and ((self.worth[:, 1] == 0) & (self.worth[:, 0] > least)).any():
            raise SpecError(
                "food may be stronger than the three weakest players together",
                where="min_food_level",
                expected=f"{least} at most, or a max_food_level",
                actual=str(self.worth[:, 0].tolist()),
                fix="lower min_food_level, or give a max_food_level",
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
            low = low + [-1, -1, 0] * self.players
            high = high + [*last, self.strongest] * self.players
        else:
            low, high = low + [-1, -1] * self.players, high + last * self.players
        return Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)

    def tables(self) -> NDArray[Any]:
        """The record that rules read."""
        fields = np.dtype(
            [
                ("ahead", "i1", (6, 2)),
                ("player_levels", "i4", self.strength.shape),
                ("food_levels", "i4", self.worth.shape),
                ("sight", "i4"),
                ("penalty", "f8"),
                ("coop", "i1"),
                ("normalized", "i1"),
                ("levels", "i1"),
            ],
            align=True,
        )
        tables = np.zeros(1, fields)
        tables[0] = (
            AHEAD,
            self.strength,
            self.worth,
            self.sight,
            self.penalty,
            self.is_coop,
            self.is_normalized,
            self.shows_levels,
        )
        return tables

    def _three(self) -> Any:
        """The least and the most that the three weakest players have together."""
        return np.sort(self.strength, axis=0)[:3].sum(axis=0)


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
                f"{name} doesn't give one level for each",
                where=name,
                expected=f"{count} levels",
                actual=repr(given),
                fix="give one level for all, or a list with one for each",
            )
        for level in each:
            if level is not None:
                check_whole(name, level, 1, HIGHEST)
        bounds.append([level or 0 for level in each])
    if high is not None and any(a > b for a, b in zip(*bounds, strict=True)):
        raise SpecError(
            "a lowest level is above the highest",
            where=f"min_{whose}_level",
            expected=f"{bounds[1]} at most",
            actual=repr(bounds[0]),
            fix="lower the lowest level, or raise the highest",
        )
    return np.array(bounds).T
