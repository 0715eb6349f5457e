"""Players of different strength load food together: Level-Based Foraging as a kernel.

Field
    R1. An episode begins with players in different random cells, each with a level drawn between
        its bounds; bounds that differ by player are dealt out at random.
    R2. Food is put down one by one in random cells that aren't at the field's edge, have no player,
        no food in the eight cells around and none two cells away in their row or column; a cell is
        drawn 1,000 times in all, then the episode has less food. Its level is drawn between its
        bounds, dealt out likewise. Without `max_food_level` the upper bound is the sum of the three
        lowest levels of players; with `force_coop` the lower bound is the upper one.
Actions, of all at once
    R3. 0 does nothing; 1 to 4 move north, south, west, east; 5 loads. A move off the field or onto
        food, and loading with no food in the four cells beside, come to nothing.
    R4. Where two or more would stand in one cell after the tick, those who wanted it by moving stay
        where they are. Players that swap cells pass. Who moves onto the cell of one that leaves it
        moves, even if that one is then refused: both stand there, as in the source.
    R5. After the moves, those that load beside the same food load it together: their levels add
        up to its level or more, and it is gone; else each pays `penalty`.
Rewards
    R6. "food": each that loaded it is paid its own level times the food's; with `normalize_reward`
        divided by the sum of the levels that loaded it times that of all food of the episode, so
        that an episode pays 1 at most. "penalty": -`penalty` to each that loaded in vain.
Observation
    R7. Numbers are float32; rows and columns are counted from the upper left corner of what the
        player sees, or of the field where that is nearer. First (row, column, level) of each food
        at most `sight` away in row and column, row by row, -1, -1, 0 for each that is missing; then
        of itself, then of the other players in order, as far as their row and column lie between 0
        and 2 `sight`; without `observe_agent_levels` they have no levels.
Ends
    R8. When no food is left all are terminated ("cleared").
    R9. After `max_episode_steps` ticks all are truncated ("horizon"). (The source says terminated.)

Source: Papoudakis et al. 2021, "Benchmarking Multi-Agent Deep Reinforcement Learning Algorithms in
Cooperative Tasks"; Albrecht & Ramamoorthy 2013; rules of the package lbforaging 2.0.0, equal step
by step but for R9, for the bounds of observations on fields that aren't square, which it swaps, and
for the cells where players of the episode before stood, which it doesn't give to those that it puts
down before them. Observations as a grid, whose space it can't make, are left out.
"""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from gamekeeper.envs import foraging_picture as picture
from gamekeeper.envs.foraging_field import Field, Levels, levels, within
from gamekeeper.envs.foraging_policies import greedy, lazy, reference
from gamekeeper.errors import SpecError
from gamekeeper.kernels import draws
from gamekeeper.kernels.faces import KernelTicks
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.rules import rule

NOTHING, NORTH, SOUTH, WEST, EAST, LOAD = range(6)
FOOD, PENALTY = range(2)
NEVER: Final = 1 << 62
"""More ticks than anybody plays."""
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


def foraging_kernel(
    *,
    players: int = 2,
    field_size: tuple[int, int] = (8, 8),
    max_num_food: int = 3,
    min_player_level: Levels = 1,
    max_player_level: Levels = 2,
    min_food_level: Levels = 1,
    max_food_level: Levels | None = None,
    sight: int | None = None,
    max_episode_steps: int = 50,
    force_coop: bool = False,
    normalize_reward: bool = True,
    observe_agent_levels: bool = True,
    penalty: float = 0.0,
) -> Kernel:
    """The foraging as a kernel; arguments as of `Foraging`."""
    rows, columns = field_size
    field = Field(
        players=players, size=field_size, foods=max_num_food,
        sight=max(rows, columns) if sight is None else sight,
        strength=levels("player", min_player_level, max_player_level, players),
        worth=levels("food", min_food_level, max_food_level, max_num_food),
        is_coop=force_coop, is_normalized=normalize_reward, shows_levels=observe_agent_levels,
        penalty=penalty,
    )  # fmt: skip
    within("max_episode_steps", max_episode_steps, 1, NEVER)
    top = np.array([rows - 1, columns - 1, max(field.best, field.strongest)])
    top = np.tile(top, (players + max_num_food, 1))
    each, foods = (players,), (max_num_food,)
    return Kernel(
        name="foraging_v0",
        agents=[f"player_{i}" for i in range(players)],
        observation_space=field.observed(),
        action_space=Discrete(6),
        state=[
            ("spawned", "i4"), ("left", "i4"), ("row", "i2", each), ("column", "i2", each),
            ("to_row", "i2", each), ("to_column", "i2", each), ("level", "i2", each),
            ("loads", "i1", each), ("food_row", "i2", foods), ("food_column", "i2", foods),
            ("worth", "i2", foods), ("dealt", "i2", foods),
            ("grid", "i2", (rows + 2, columns + 2)),
        ],
        reset=reset,
        step=step,
        observe=observe,
        inform=inform,
        info=[("left", "i8"), ("foods", "i8")],
        overview=overview,
        state_space=Box(np.zeros_like(top), top, dtype=np.int64),
        tables=field.tables(),
        terms=("food", "penalty"),
        endings=("cleared",),
        horizon=max_episode_steps,
    )  # fmt: skip


_ID: Final = re.compile(
    r"Foraging(?P<sight>-2s)?-(?P<rows>\d+)x(?P<columns>\d+)-(?P<players>\d+)p-(?P<food>\d+)f"
    r"(?P<coop>-coop)?(?P<pen>-pen)?-v3"
)


def arguments_of(gymnasium_id: str) -> dict[str, Any]:
    """The arguments of the task that lbforaging registers under an id, as `Foraging-8x8-2p-3f-v3`.

    Raises:
        SpecError: it registers none, or one with observations as a grid.
    Source: `lbforaging/__init__.py`, lbforaging 2.0.0.
    """
    found = _ID.fullmatch(gymnasium_id)
    if found is None:
        raise SpecError(
            "lbforaging has no such environment with flattened observations",
            where="gymnasium_id",
            expected="as Foraging-8x8-2p-3f-v3 or Foraging-2s-10x10-3p-3f-coop-v3",
            seen=repr(gymnasium_id),
        )
    return {
        "players": int(found["players"]), "max_num_food": int(found["food"]),
        "field_size": (int(found["rows"]), int(found["columns"])),
        "sight": 2 if found["sight"] else int(found["rows"]), "force_coop": bool(found["coop"]),
        "penalty": 0.1 if found["pen"] else 0.0,
    }  # fmt: skip


class Foraging(KernelTicks):
    """Each player sees [3 max_num_food + 3 players] float32 numbers (R7); actions are 0 to 5.

    Arguments are named as lbforaging's; `Foraging(**arguments_of("Foraging-8x8-2p-3f-v3"))` is what
    Gymnasium makes of that id.

    Args:
        players: how many.
        field_size: rows and columns, 3 or more.
        max_num_food: how much food an episode begins with at most.
        min_player_level, max_player_level: bounds of levels, for all or for each.
        min_food_level, max_food_level: likewise of food; None: what the three weakest players can
            load together.
        sight: how far players see, in rows and columns; None: everything.
        max_episode_steps: ticks after which an episode is cut.
        force_coop: all food has its highest level.
        normalize_reward: an episode pays 1 at most (R6).
        observe_agent_levels: players see the levels of players.
        penalty: what loading in vain costs.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints.
    Raises:
        SpecError: a number is out of its range.
    """

    metadata = {  # noqa: RUF012  # PettingZoo declares it so
        "name": "foraging_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 5,
        "is_parallelizable": True,
    }
    contract = "foraging.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012
    not_batched = ""

    def __init__(
        self, *, render_mode: str | None = None, debug: bool = False, **arguments: Any
    ) -> None:
        kernel = foraging_kernel(**arguments)
        super().__init__(kernel, render_mode=render_mode, debug=debug)

    def render(self) -> str | NDArray[np.uint8] | None:
        """The field in letters, or in cells of 24 pixels, [24 rows, 24 columns, 3]."""
        if self.render_mode is None:
            return None
        rows, columns = (side - 2 for side in self.bench.records["grid"].shape[1:])
        players = len(self.possible_agents)
        return picture.draw(
            self.state(), players, (rows, columns), is_text=self.render_mode == "ansi"
        )
