"""Two players mark the cells of a 3 by 3 board; three in a row win.

    R1. The board is empty. `player_1` begins; then they take turns.
    R2. Action c marks cell c; cells are numbered along the first axis of the planes, then the
        second: 0, 1, 2 are [0, 0], [0, 1], [0, 2].
    R3. A player with three marks in a row as its turn ends has won: it is paid 1 and the other -1
        ("game"), and both are terminated ("won").
    R4. When all cells are marked and no player has won, both are terminated ("drawn").
    R5. A player that marks a marked cell is paid -1 and the other 0 ("illegal"); both are
        terminated and truncated ("illegal").
    R6. A player sees two planes, its own marks and the other's. The mask shows the free cells to
        the player in turn, and to nobody else while the game goes on.
    R7. After a won or drawn game the player whose turn it would be has its last turn first, after
        an illegal mark player_1.

Values of `last`, rewards, their sums and flags are those of PettingZoo's tictactoe_v3, as its
`env()` makes it. Its infos are empty; ours hold the mask, as those of all our tasks do.

Source: PettingZoo 1.27, classic/tictactoe, with its TerminateIllegalWrapper (illegal_reward -1).
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.tasks.board_games import BoardGame, Seen, board_kernel, break_off, judge, lazy
from gamekeeper.tasks.drawing import BLUE, ORANGE, PAPER, STONE, Canvas, metadata_of

SIDE: Final = 3
CELLS: Final = SIDE * SIDE
AGENTS: Final = ("player_1", "player_2")
ROWS_OF_THREE: Final = (
    (0, 1, 2),
    (3, 4, 5),
    (6, 7, 8),
    (0, 3, 6),
    (1, 4, 7),
    (2, 5, 8),
    (0, 4, 8),
    (2, 4, 6),
)
METADATA: Final = metadata_of("tictactoe_v3", fps=1, is_parallelizable=False)

# -- rules


@rule
def act(s, agent, cell, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Marks a cell, which may end the game (R2 to R5, R7)."""
    if s.board[cell] != 0:
        break_off(s, agent, rewards, terminated, truncated)
        return
    s.board[cell] = agent + 1
    judge(s, agent, has_three(s, agent + 1), s.time == CELLS, rewards, terminated)


@rule
def has_three(s, mark):  # type: ignore[no-untyped-def]  # likewise
    """True if a player has three in a row (R3)."""
    for a, b, c in ROWS_OF_THREE:
        if s.board[a] == mark and s.board[b] == mark and s.board[c] == mark:
            return True
    return False


def tictactoe_kernel() -> Kernel:
    """Returns the rules as a kernel."""
    return board_kernel(METADATA, AGENTS, (SIDE, SIDE), CELLS, act)


# -- policies


def reference(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Plays perfectly, and takes by chance one of the marks that keep the best outcome."""
    own, other = _marks(observation)
    legal = np.flatnonzero(observation["action_mask"]).tolist()
    values = [-_value(other, own | 1 << cell) for cell in legal]
    best = [cell for cell, value in zip(legal, values, strict=True) if value == max(values)]
    return int(best[int(rng.integers(len(best)))])


def greedy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Wins where it can, else marks any free cell; doesn't look at the other's marks."""
    own, _ = _marks(observation)
    legal = np.flatnonzero(observation["action_mask"]).tolist()
    wins = [cell for cell in legal if _is_won(own | 1 << cell)]
    return int(wins[0] if wins else legal[int(rng.integers(len(legal)))])


def _marks(observation: Seen) -> tuple[int, int]:
    """Returns the own marks and the other's, a bit for each cell."""
    planes = observation["observation"].reshape(CELLS, 2)
    own, other = ((1 << np.flatnonzero(planes[:, k])).sum() for k in (0, 1))
    return int(own), int(other)


def _is_won(marks: int) -> bool:
    return any(all(marks >> cell & 1 for cell in three) for three in ROWS_OF_THREE)


@cache
def _value(own: int, other: int) -> int:
    """Value of the game to the player that marks next, if both play perfectly: 1, 0 or -1."""
    if _is_won(other):
        return -1
    free = [cell for cell in range(CELLS) if not (own | other) >> cell & 1]
    return max((-_value(other, own | 1 << cell) for cell in free), default=0)


# -- the environment


class Tictactoe(BoardGame):
    """Tic-tac-toe as PettingZoo has it, from rules that compile; see R1 to R7.

    Args:
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints in them.
    """

    metadata = METADATA
    contract = "tictactoe.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so

    def __init__(self, *, render_mode: str | None = None, debug: bool = False) -> None:
        super().__init__(tictactoe_kernel(), render_mode=render_mode, debug=debug)

    def pixels(self) -> NDArray[np.uint8]:
        """Board with discs as marks, in cells of 24 pixels, [72, 72, 3]."""
        canvas = Canvas(SIDE, SIDE, background=STONE)
        for (row, column), mark in np.ndenumerate(self.board()):
            canvas.fill(column, row, PAPER, inset=0.05)
            if mark:
                canvas.disc(column, row, (BLUE, ORANGE)[mark - 1])
        return canvas.pixels
