"""Two players drop tokens into a standing grid; four in a row win.

    R1. The grid has 6 rows and 7 columns and is empty. `player_0` begins; then they take turns.
    R2. Action c drops a token into column c, where it falls to the lowest empty cell.
    R3. Who has four tokens in a row (level, upright or along a diagonal) as its turn ends has won:
        it is paid 1 and the other -1 ("game"), and both are terminated ("won").
    R4. When the grid is full and nobody has won, both are terminated ("drawn").
    R5. Who drops a token into a full column is paid -1 and the other 0 ("illegal"); both are
        terminated and truncated ("illegal").
    R6. A player sees two planes, its own tokens and the other's. The mask shows the columns that
        aren't full to the player in turn, and to nobody else while the game goes on.
    R7. After a won or drawn game the player whose turn it would be has its last turn first, after
        an illegal drop player_0.

What `last` tells, rewards, their sums and flags are those of PettingZoo's connect_four_v3, as its
`env()` makes it. Its infos are empty; ours hold the mask, as those of all our tasks do.

Source: PettingZoo 1.27, classic/connect_four, with its TerminateIllegalWrapper (illegal_reward -1).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.envs.drawing import BLUE, ORANGE, PAPER, YELLOW, Canvas, text_of
from gamekeeper.kernels.faces import MaskedTurns
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.rules import rule

ROWS: Final = 6
COLUMNS: Final = 7
CELLS: Final = ROWS * COLUMNS
LONG: Final = 4
"""Tokens in a row that win."""
AGENTS: Final = ("player_0", "player_1")
GAME, ILLEGAL = range(2)
WON, DRAWN, BROKEN = 1, 2, 3
LETTERS: Final = ".XO"
METADATA: Final = {
    "name": "connect_four_v3",
    "render_modes": ["ansi", "rgb_array"],
    "render_fps": 2,
    "is_parallelizable": False,
}

# -- rules


@rule
def reset(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """An empty grid, player_0 in turn (R1): all is zero already."""


@rule
def act(s, agent, column, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """A token falls, and the game may be over (R2 to R5, R7)."""
    if s.board[column] != 0:
        rewards[agent, ILLEGAL] = -1.0
        for i in range(2):
            terminated[i] = True
            truncated[i] = True
            s.ending[i] = BROKEN
        s.turn = 0
        return
    row = ROWS - 1
    while s.board[row * COLUMNS + column] != 0:
        row -= 1
    s.board[row * COLUMNS + column] = agent + 1
    s.tokens += 1
    s.turn = 1 - agent
    if has_four(s, row, column):
        rewards[agent, GAME] = 1.0
        rewards[1 - agent, GAME] = -1.0
        end(s, terminated, WON)
    elif s.tokens == CELLS:
        end(s, terminated, DRAWN)


@rule
def end(s, terminated, why):  # type: ignore[no-untyped-def]  # likewise
    """The game is over for both."""
    for i in range(2):
        terminated[i] = True
        s.ending[i] = why


@rule
def has_four(s, row, column):  # type: ignore[no-untyped-def]  # likewise
    """Whether a row of four leads through the token that has just fallen (R3)."""
    for k in range(4):
        down = 0 if k == 0 else 1
        right = k - 2 if k != 0 else 1
        count = 1 + run(s, row, column, down, right) + run(s, row, column, -down, -right)
        if count >= LONG:
            return True
    return False


@rule
def run(s, row, column, down, right):  # type: ignore[no-untyped-def]  # likewise
    """How many tokens of the same player follow on a token in a direction."""
    token = s.board[row * COLUMNS + column]
    count = 0
    for _ in range(LONG - 1):
        row += down
        column += right
        if row < 0 or row >= ROWS or column < 0 or column >= COLUMNS:
            break
        if s.board[row * COLUMNS + column] != token:
            break
        count += 1
    return count


@rule
def observe(s, agent, obs):  # type: ignore[no-untyped-def]  # likewise
    """The own tokens, and the other's (R6)."""
    for row in range(ROWS):
        for column in range(COLUMNS):
            token = s.board[row * COLUMNS + column]
            obs.observation[row, column, 0] = token == agent + 1
            obs.observation[row, column, 1] = token == 2 - agent


@rule
def mask(s, agent, flags):  # type: ignore[no-untyped-def]  # likewise
    """Columns that aren't full, for who is in turn or has its last turn (R6)."""
    is_told = agent == s.turn or s.live[agent] == 0
    for column in range(COLUMNS):
        flags[column] = is_told and s.board[column] == 0


@rule
def overview(s, state):  # type: ignore[no-untyped-def]  # likewise
    """The grid: 0 empty, 1 player_0's, 2 player_1's."""
    for row in range(ROWS):
        for column in range(COLUMNS):
            state[row, column] = s.board[row * COLUMNS + column]


def connect_four_kernel() -> Kernel:
    """The rules as a kernel."""
    return Kernel(
        name="connect_four_v3",
        agents=AGENTS,
        observation_space=Dict(
            {
                "observation": Box(0, 1, (ROWS, COLUMNS, 2), np.int8),
                "action_mask": Box(0, 1, (COLUMNS,), np.int8),
            }
        ),
        action_space=Discrete(COLUMNS),
        state=[("board", "i1", (CELLS,)), ("tokens", "i1")],
        reset=reset,
        act=act,
        observe=observe,
        mask=mask,
        plays_illegal=True,
        overview=overview,
        state_space=Box(0, 2, (ROWS, COLUMNS), np.int8),
        terms=("game", "illegal"),
        endings=("won", "drawn", "illegal"),
        metadata=METADATA,
    )


# -- policies


def reference(
    observation: Mapping[str, NDArray[np.int8]], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Wins where it can, else forbids the other's four, prepares none for it, stays central."""
    board, legal = observation["observation"], _central(observation["action_mask"])
    for who in (0, 1):
        for column in legal:
            if _wins(board, column, who):
                return column
    safe = [column for column in legal if not _prepares(board, column)]
    return (safe or legal)[0]


def greedy(
    observation: Mapping[str, NDArray[np.int8]], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Wins where it can, else drops into any open column; doesn't look at the other's tokens."""
    legal = _central(observation["action_mask"])
    wins = [column for column in legal if _wins(observation["observation"], column, 0)]
    return wins[0] if wins else legal[int(rng.integers(len(legal)))]


def lazy(
    observation: Mapping[str, NDArray[np.int8]], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Drops into the leftmost open column."""
    return int(observation["action_mask"].argmax())


def _central(flags: NDArray[np.int8]) -> list[int]:
    """The open columns, the middle one first."""
    return sorted(np.flatnonzero(flags).tolist(), key=lambda column: (abs(column - 3), column))


def _wins(board: NDArray[np.int8], column: int, who: int, above: int = 0) -> bool:
    """A token of plane `who`, so many cells above where the next one falls, makes four."""
    row = int((board[:, column].sum(-1) == 0).sum()) - 1 - above
    if row < 0:
        return False
    plane = board[:, :, who]
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        count = 1
        for sign in (1, -1):
            r, c = row + sign * down, column + sign * right
            while 0 <= r < ROWS and 0 <= c < COLUMNS and plane[r, c]:
                count, r, c = count + 1, r + sign * down, c + sign * right
        if count >= LONG:
            return True
    return False


def _prepares(board: NDArray[np.int8], column: int) -> bool:
    """A token there lets the other make four on top of it."""
    return _wins(board, column, 1, above=1)


# -- the face


class ConnectFour(MaskedTurns):
    """Connect Four as PettingZoo has it, from rules that compile; see R1 to R7.

    Args:
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints in them.
    """

    metadata = METADATA
    contract = "connect_four.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so
    not_batched = ""

    def __init__(self, *, render_mode: str | None = None, debug: bool = False) -> None:
        super().__init__(connect_four_kernel(), render_mode=render_mode, debug=debug)

    def first_to_leave(self) -> Any:
        """Whose turn it would be (R7)."""
        return self.next_agent(self.agent_selection)

    def render(self) -> str | NDArray[np.uint8] | None:
        """The grid: `X` player_0, `O` player_1; or discs in cells of 24 pixels, [144, 168, 3]."""
        grid = self.bench.records["board"][0].reshape(ROWS, COLUMNS)
        if self.render_mode == "ansi":
            return text_of([LETTERS[token] for token in row] for row in grid)
        if self.render_mode != "rgb_array":
            return None
        canvas = Canvas(COLUMNS, ROWS, background=BLUE)
        for row, column in np.ndindex(ROWS, COLUMNS):
            canvas.disc(column, row, (PAPER, YELLOW, ORANGE)[grid[row, column]])
        return canvas.pixels
