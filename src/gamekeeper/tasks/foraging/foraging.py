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

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import KernelTicks
from gamekeeper.tasks import drawing
from gamekeeper.tasks.arguments import NEVER, check_whole
from gamekeeper.tasks.drawing import Canvas, Pictured, metadata_of
from gamekeeper.tasks.foraging import foraging_rules as rules
from gamekeeper.tasks.foraging.foraging_rules import FoodField, Levels, levels

DIGITS: Final = "0123456789"
LETTERS: Final = "_abcdefghijklmnopqrstuvwxyz"
DOTS: Final = 9
"""Levels that a picture can show, in dots three by three; higher ones look like the last."""


def _dots(canvas: Canvas, row: int, column: int, level: int) -> None:
    for dot in range(min(level, DOTS)):
        y, x = divmod(dot, 3)
        canvas.rectangle(column + 0.24 + 0.2 * x, row + 0.24 + 0.2 * y, 0.12, 0.12, drawing.PAPER)


NOTHING, NORTH, SOUTH, WEST, EAST, LOAD = range(6)


def reference(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """All go to the food that lies nearest to all of them together, and load it."""
    foods, players = _seen(observation, int(info["foods"]))
    if not len(foods):
        return int(rng.integers(NORTH, LOAD))
    distance = np.abs(foods[:, None, :2] - players[None, :, :2]).sum(axis=(1, 2))
    return _towards(foods[int(distance.argmin())], players, rng)


def greedy(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Goes to the food that lies nearest to itself, strong enough for it or not."""
    foods, players = _seen(observation, int(info["foods"]))
    if not len(foods):
        return int(rng.integers(NORTH, LOAD))
    distance = np.abs(foods[:, :2] - players[0, :2]).sum(axis=1)
    return _towards(foods[int(distance.argmin())], players, rng)


def lazy(
    observation: NDArray[np.float32], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Does nothing."""
    return NOTHING


def _seen(
    observation: NDArray[np.float32], count: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(row, column, level) of food and of players, without what isn't seen; oneself first."""
    rows = observation.reshape(-1, 3)
    foods, players = rows[:count], rows[count:]
    return foods[foods[:, 2] > 0], players[players[:, 2] > 0]


def _towards(food: NDArray[np.float32], players: NDArray[np.float32], rng: Generator) -> int:
    """A step to the side of the food; around others with a random step now and then."""
    down, right = (food - players[0])[:2]
    if abs(down) + abs(right) == 1:
        return LOAD
    if rng.random() < 0.15:
        return int(rng.integers(NORTH, LOAD))
    if abs(down) > abs(right):
        return SOUTH if down > 0 else NORTH
    return EAST if right > 0 else WEST


def _state(players: int, max_num_food: int, field_size: tuple[int, int]) -> list[tuple[Any, ...]]:
    """Fields of the kernel's state: name, dtype, shape; the grid has a border of one cell."""
    rows, columns = field_size
    each, foods = (players,), (max_num_food,)
    return [
        ("spawned", "i4"),
        ("left", "i4"),
        ("row", "i2", each),
        ("column", "i2", each),
        ("to_row", "i2", each),
        ("to_column", "i2", each),
        ("level", "i2", each),
        ("loads", "i1", each),
        ("food_row", "i2", foods),
        ("food_column", "i2", foods),
        ("worth", "i2", foods),
        ("dealt", "i2", foods),
        ("grid", "i2", (rows + 2, columns + 2)),
    ]


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
    field = FoodField(
        players=players,
        size=field_size,
        foods=max_num_food,
        sight=max(rows, columns) if sight is None else sight,
        strength=levels("player", min_player_level, max_player_level, players),
        worth=levels("food", min_food_level, max_food_level, max_num_food),
        is_coop=force_coop,
        is_normalized=normalize_reward,
        shows_levels=observe_agent_levels,
        penalty=penalty,
    )
    check_whole("max_episode_steps", max_episode_steps, 1, NEVER)
    top = np.array([rows - 1, columns - 1, max(field.best, field.strongest)])
    top = np.tile(top, (players + max_num_food, 1))
    return Kernel(
        name="foraging_v0",
        agents=[f"player_{i}" for i in range(players)],
        observation_space=field.observed(),
        action_space=Discrete(6),
        state=_state(players, max_num_food, field_size),
        reset=rules.reset,
        step=rules.step,
        observe=rules.observe,
        inform=rules.inform,
        info=[("left", "i8"), ("foods", "i8")],
        overview=rules.overview,
        state_space=Box(np.zeros_like(top), top, dtype=np.int64),
        tables=field.tables(),
        terms=("food", "penalty"),
        endings=("cleared",),
        horizon=max_episode_steps,
    )


class Foraging(Pictured, KernelTicks):
    """Each player sees [3 max_num_food + 3 players] float32 numbers (R7); actions are 0 to 5.

    Arguments are named as lbforaging's.

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

    metadata = metadata_of("foraging_v0", fps=5)
    contract = "foraging.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so

    def __init__(
        self, *, render_mode: str | None = None, debug: bool = False, **arguments: Any
    ) -> None:
        kernel = foraging_kernel(**arguments)
        super().__init__(kernel, render_mode=render_mode, debug=debug)

    def letters(self) -> str:
        """Field in letters.

        `1` to `9` food by its level (`+`: higher), `a` a player of level 1, `b` of level 2 and so
        on, capital where several share a cell.
        """
        rows, columns = self._size()
        letters = [["."] * columns for _ in range(rows)]
        players, foods = self._placed()
        for row, column, level in foods:
            letters[row][column] = DIGITS[level] if level < len(DIGITS) else "+"
        for row, column, level in players:
            is_taken = letters[row][column] != "."
            letter = LETTERS[min(level, len(LETTERS) - 1)]
            letters[row][column] = letter.upper() if is_taken else letter
        return drawing.text_of(letters)

    def pixels(self) -> NDArray[np.uint8]:
        """Field in cells of 24 pixels, [24 rows, 24 columns, 3]; dots tell the level.

        Food is green, players are blue.
        """
        rows, columns = self._size()
        canvas = Canvas(columns, rows)
        players, foods = self._placed()
        for row, column, level in foods:
            canvas.fill(column, row, drawing.GREEN, inset=0.1)
            _dots(canvas, row, column, level)
        for row, column, level in players:
            canvas.disc(column, row, drawing.BLUE, radius=0.46)
            _dots(canvas, row, column, level)
        return canvas.pixels

    def _size(self) -> tuple[int, ...]:
        return tuple(side - 2 for side in self.memory.records["grid"].shape[1:])

    def _placed(self) -> tuple[list[list[int]], list[list[int]]]:
        """Row, column and level of each player, and of each food that is left."""
        rows, count = self.state().tolist(), len(self.possible_agents)
        return rows[:count], [row for row in rows[count:] if row[2] > 0]
