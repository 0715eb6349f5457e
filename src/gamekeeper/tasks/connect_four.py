"""Two players drop tokens into a standing grid; four in a row win.

    R1. The grid has 6 rows and 7 columns and is empty. `player_0` begins; then they take turns.
    R2. Action c drops a token into column c, where it falls to the lowest empty cell.
    R3. A player with four tokens in a row (level, upright or along a diagonal) as its turn ends has
        won: it is paid 1 and the other -1 ("game"), and both are terminated ("won").
    R4. When the grid is full and no player has won, both are terminated ("drawn").
    R5. A player that drops into a full column is paid -1 and the other 0 ("illegal"); both are
        terminated and truncated ("illegal").
    R6. A player sees two planes, its own tokens and the other's. The mask shows the columns that
        aren't full to the player in turn alone, while the game goes on.
    R7. After a won or drawn game the player whose turn it would be has its last turn first, after
        an illegal drop player_0.

Values of `last`, rewards, their sums and flags are those of PettingZoo's connect_four_v3, as its
`env()` makes it. Its infos are empty; ours hold the mask, as those of all our tasks do.

Source: PettingZoo 1.27, classic/connect_four, with its TerminateIllegalWrapper (illegal_reward -1).
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.tasks.board_games import BoardGame, Seen, board_kernel, break_off, judge, lazy
from gamekeeper.tasks.drawing import BLUE, ORANGE, PAPER, YELLOW, Canvas, metadata_of

ROWS: Final = 6
COLUMNS: Final = 7
CELLS: Final = ROWS * COLUMNS
LONG: Final = 4
"""Tokens in a row that win."""
AGENTS: Final = ("player_0", "player_1")
METADATA: Final = metadata_of("connect_four_v3", fps=2, is_parallelizable=False)

# -- rules


@rule
def act(s, agent, column, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Drops a token, which may end the game (R2 to R5, R7)."""
    if s.board[column] != 0:
        break_off(s, agent, rewards, terminated, truncated)
        return
    row = ROWS - 1
    while s.board[row * COLUMNS + column] != 0:
        row -= 1
    s.board[row * COLUMNS + column] = agent + 1
    s.tokens += 1
    judge(s, agent, has_four(s, row, column), s.tokens == CELLS, rewards, terminated)


@rule
def has_four(s, row, column):  # type: ignore[no-untyped-def]  # likewise
    """True if a row of four leads through the token that has just fallen (R3)."""
    for k in range(4):
        down = 0 if k == 0 else 1
        right = k - 2 if k != 0 else 1
        count = 1 + run(s, row, column, down, right) + run(s, row, column, -down, -right)
        if count >= LONG:
            return True
    return False


@rule
def run(s, row, column, down, right):  # type: ignore[no-untyped-def]  # likewise
    """Counts tokens of the same player that follow on a token in a direction."""
    token = s.board[row * COLUMNS + column]
    count = 0
    for _ in range(LONG - 1):
        row += down
        column += right
        if row < 0 or row >= ROWS or column < 0 or column >= COLUMNS:
            return count
        if s.board[row * COLUMNS + column] != token:
            return count
        count += 1
    return count


def connect_four_kernel() -> Kernel:
    """Returns the rules as a kernel."""
    more = (("tokens", "i1"),)
    return board_kernel(METADATA, AGENTS, (ROWS, COLUMNS), COLUMNS, act, more=more)


# -- policies


def reference(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Wins where it can, else forbids the other's four, prepares none for it, stays central."""
    board, legal = observation["observation"], _central(observation["action_mask"])
    for plane in (0, 1):
        for column in legal:
            if _wins(board, column, plane):
                return column
    # a token that lets the other make four on top of it isn't safe
    safe = [column for column in legal if not _wins(board, column, 1, above=1)]
    return (safe or legal)[0]


def greedy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Wins where it can, else drops into any open column; doesn't look at the other's tokens."""
    legal = _central(observation["action_mask"])
    wins = [column for column in legal if _wins(observation["observation"], column, 0)]
    return wins[0] if wins else legal[int(rng.integers(len(legal)))]


def _central(flags: NDArray[np.int8]) -> list[int]:
    """Returns the open columns, the middle one first."""
    return sorted(np.flatnonzero(flags).tolist(), key=lambda column: (abs(column - 3), column))


def _wins(board: NDArray[np.int8], column: int, plane: int, above: int = 0) -> bool:
    """True if a token of a plane, so many cells above the next one's, makes four."""
    row = int((board[:, column].sum(-1) == 0).sum()) - 1 - above
    if row < 0:
        return False
    marks = board[:, :, plane]
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        count = 1
        for sign in (1, -1):
            r, c = row + sign * down, column + sign * right
            while 0 <= r < ROWS and 0 <= c < COLUMNS and marks[r, c]:
                count, r, c = count + 1, r + sign * down, c + sign * right
        if count >= LONG:
            return True
    return False


# -- the environment


class ConnectFour(BoardGame):
    """Connect Four as PettingZoo has it, from rules that compile; see R1 to R7.

    Args:
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints in them.
    """

    metadata = METADATA
    contract = "connect_four.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so

    def __init__(self, *, render_mode: str | None = None, debug: bool = False) -> None:
        super().__init__(connect_four_kernel(), render_mode=render_mode, debug=debug)

    def pixels(self) -> NDArray[np.uint8]:
        """Grid with discs as tokens, in cells of 24 pixels, [144, 168, 3]."""
        canvas = Canvas(COLUMNS, ROWS, background=BLUE)
        for (row, column), mark in np.ndenumerate(self.board()):
            canvas.disc(column, row, (PAPER, YELLOW, ORANGE)[mark])
        return canvas.pixels
