"""The rules of `foraging`, R1 to R9 of its docstring, over one copy's state."""

from __future__ import annotations

from typing import Final

from gamekeeper.kernels import draws
from gamekeeper.kernels.rules import rule

NOTHING, NORTH, SOUTH, WEST, EAST, LOAD = range(6)
FOOD, PENALTY = range(2)
CLEARED: Final = 1
"""Which of the endings it is, from 1."""
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
    """Whether one of the first `count` players stands there."""
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
    """Whether food may lie there (R2); walls are as good as nothing."""
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
    """Whether player i loads food k, beside which it stands."""
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
    """How much food is left, and how much observations have room for, before the players."""
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
