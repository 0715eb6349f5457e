"""Two players mark the cells of a 3 by 3 board; three in a row win.

    R1. The board is empty. `player_1` begins; then they take turns.
    R2. Action c marks cell c; cells are numbered along the first axis of the planes, then the
        second: 0, 1, 2 are [0, 0], [0, 1], [0, 2].
    R3. Who has three marks in a row as its turn ends has won: it is paid 1 and the other -1
        ("game"), and both are terminated ("won").
    R4. When all cells are marked and nobody has won, both are terminated ("drawn").
    R5. Who marks a cell that is marked is paid -1 and the other 0 ("illegal"); both are terminated
        and truncated ("illegal").
    R6. A player sees two planes, its own marks and the other's. The mask shows the free cells to
        the player in turn, and to nobody else while the game goes on.
    R7. After a won or drawn game the player whose turn it would be has its last turn first, after
        an illegal mark player_1.

What `last` tells, rewards, their sums and flags are those of PettingZoo's tictactoe_v3, as its
`env()` makes it. Its infos are empty; ours hold the mask, as those of all our tasks do.

Source: PettingZoo 1.27, classic/tictactoe, with its TerminateIllegalWrapper (illegal_reward -1).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.envs.drawing import BLUE, ORANGE, PAPER, STONE, Canvas, text_of
from gamekeeper.kernels.faces import MaskedTurns
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.rules import rule

SIDE: Final = 3
CELLS: Final = SIDE * SIDE
AGENTS: Final = ("player_1", "player_2")
GAME, ILLEGAL = range(2)
WON, DRAWN, BROKEN = 1, 2, 3
ROWS_OF_THREE: Final = (
    (0, 1, 2), (3, 4, 5), (6, 7, 8), (0, 3, 6), (1, 4, 7), (2, 5, 8), (0, 4, 8), (2, 4, 6),
)  # fmt: skip
LETTERS: Final = ".XO"
METADATA: Final = {
    "name": "tictactoe_v3",
    "render_modes": ["ansi", "rgb_array"],
    "render_fps": 1,
    "is_parallelizable": False,
}

# -- rules


@rule
def reset(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """An empty board, player_1 in turn (R1): all is zero already."""


@rule
def act(s, agent, cell, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """A mark, and the game may be over (R2 to R5, R7)."""
    if s.board[cell] != 0:
        rewards[agent, ILLEGAL] = -1.0
        for i in range(2):
            terminated[i] = True
            truncated[i] = True
            s.ending[i] = BROKEN
        s.turn = 0
        return
    s.board[cell] = agent + 1
    s.turn = 1 - agent
    if has_three(s, agent + 1):
        rewards[agent, GAME] = 1.0
        rewards[1 - agent, GAME] = -1.0
        end(s, terminated, WON)
    elif s.time == CELLS:
        end(s, terminated, DRAWN)


@rule
def end(s, terminated, why):  # type: ignore[no-untyped-def]  # likewise
    """The game is over for both."""
    for i in range(2):
        terminated[i] = True
        s.ending[i] = why


@rule
def has_three(s, token):  # type: ignore[no-untyped-def]  # likewise
    """Whether a player has three in a row (R3)."""
    for a, b, c in ROWS_OF_THREE:
        if s.board[a] == token and s.board[b] == token and s.board[c] == token:
            return True
    return False


@rule
def observe(s, agent, obs):  # type: ignore[no-untyped-def]  # likewise
    """The own marks, and the other's (R6)."""
    for cell in range(CELLS):
        token = s.board[cell]
        obs.observation[cell // SIDE, cell % SIDE, 0] = token == agent + 1
        obs.observation[cell // SIDE, cell % SIDE, 1] = token == 2 - agent


@rule
def mask(s, agent, flags):  # type: ignore[no-untyped-def]  # likewise
    """Free cells, for who is in turn or has its last turn (R6)."""
    is_told = agent == s.turn or s.live[agent] == 0
    for cell in range(CELLS):
        flags[cell] = is_told and s.board[cell] == 0


@rule
def overview(s, state):  # type: ignore[no-untyped-def]  # likewise
    """The board: 0 free, 1 player_1's, 2 player_2's."""
    for cell in range(CELLS):
        state[cell // SIDE, cell % SIDE] = s.board[cell]


def tictactoe_kernel() -> Kernel:
    """The rules as a kernel."""
    return Kernel(
        name="tictactoe_v3",
        agents=AGENTS,
        observation_space=Dict(
            {
                "observation": Box(0, 1, (SIDE, SIDE, 2), np.int8),
                "action_mask": Box(0, 1, (CELLS,), np.int8),
            }
        ),
        action_space=Discrete(CELLS),
        state=[("board", "i1", (CELLS,))],
        reset=reset,
        act=act,
        observe=observe,
        mask=mask,
        plays_illegal=True,
        overview=overview,
        state_space=Box(0, 2, (SIDE, SIDE), np.int8),
        terms=("game", "illegal"),
        endings=("won", "drawn", "illegal"),
        metadata=METADATA,
    )


# -- policies


def reference(
    observation: Mapping[str, NDArray[np.int8]], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Plays perfectly, and takes by chance one of the marks that keep the best outcome."""
    own, other = _marks(observation)
    legal = np.flatnonzero(observation["action_mask"]).tolist()
    values = [-_value(other, own | 1 << cell) for cell in legal]
    best = [cell for cell, value in zip(legal, values, strict=True) if value == max(values)]
    return int(best[int(rng.integers(len(best)))])


def greedy(
    observation: Mapping[str, NDArray[np.int8]], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Wins where it can, else marks any free cell; doesn't look at the other's marks."""
    own, _ = _marks(observation)
    legal = np.flatnonzero(observation["action_mask"]).tolist()
    wins = [cell for cell in legal if _is_won(own | 1 << cell)]
    return int(wins[0] if wins else legal[int(rng.integers(len(legal)))])


def lazy(
    observation: Mapping[str, NDArray[np.int8]], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Marks the first free cell."""
    return int(observation["action_mask"].argmax())


def _marks(observation: Mapping[str, NDArray[np.int8]]) -> tuple[int, int]:
    """The own marks and the other's, a bit for each cell."""
    planes = observation["observation"].reshape(CELLS, 2)
    own, other = ((1 << np.flatnonzero(planes[:, k])).sum() for k in (0, 1))
    return int(own), int(other)


def _is_won(marks: int) -> bool:
    return any(all(marks >> cell & 1 for cell in three) for three in ROWS_OF_THREE)


@cache
def _value(own: int, other: int) -> int:
    """What the game is worth to who marks next, if both play perfectly: 1, 0 or -1."""
    if _is_won(other):
        return -1
    free = [cell for cell in range(CELLS) if not (own | other) >> cell & 1]
    return max((-_value(other, own | 1 << cell) for cell in free), default=0)


# -- the face


class Tictactoe(MaskedTurns):
    """Tic-tac-toe as PettingZoo has it, from rules that compile; see R1 to R7.

    Args:
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints in them.
    """

    metadata = METADATA
    contract = "tictactoe.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so
    not_batched = ""

    def __init__(self, *, render_mode: str | None = None, debug: bool = False) -> None:
        super().__init__(tictactoe_kernel(), render_mode=render_mode, debug=debug)

    def first_to_leave(self) -> Any:
        """Whose turn it would be (R7)."""
        return self.next_agent(self.agent_selection)

    def render(self) -> str | NDArray[np.uint8] | None:
        """The board: `X` player_1, `O` player_2; or discs in cells of 24 pixels, [72, 72, 3]."""
        grid = self.bench.records["board"][0].reshape(SIDE, SIDE)
        if self.render_mode == "ansi":
            return text_of([LETTERS[token] for token in row] for row in grid)
        if self.render_mode != "rgb_array":
            return None
        canvas = Canvas(SIDE, SIDE, background=STONE)
        for row, column in np.ndindex(SIDE, SIDE):
            canvas.fill(column, row, PAPER, inset=0.05)
            if grid[row, column]:
                canvas.disc(column, row, (BLUE, ORANGE)[grid[row, column] - 1])
        return canvas.pixels
