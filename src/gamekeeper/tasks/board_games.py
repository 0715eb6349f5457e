"""Rules and class of tic-tac-toe and Connect Four: two players mark the cells of a board.

`s.board` holds the cells row by row, 0 free, 1 and 2 marked by the first and the second player. An
action is refused where `s.board[action]` is marked: of Connect Four that is the column's top cell.
"""

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.kernels.kernel import Field, Kernel
from gamekeeper.kernels.kernel_env import MaskedTurns
from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.tasks.drawing import Pictured, text_of

Seen: TypeAlias = Mapping[str, NDArray[np.int8]]

GAME, ILLEGAL = range(2)
"""Reward terms."""
WON, DRAWN, BROKEN = 1, 2, 3
"""Endings."""
LETTERS: Final = ".XO"


@rule
def reset(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Leaves an empty board with the first player in turn (R1): all is zero already."""


@rule
def break_off(s, agent, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """Ends the game after an illegal action, with the first player in turn (R5, R7)."""
    rewards[agent, ILLEGAL] = -1.0
    for i in range(2):
        terminated[i] = True
        truncated[i] = True
        s.ending[i] = BROKEN
    s.turn = 0


@rule
def judge(s, agent, is_won, is_full, rewards, terminated):  # type: ignore[no-untyped-def]  # likewise
    """Passes the turn, and ends a game that is won or drawn (R3, R4)."""
    s.turn = 1 - agent
    if is_won:
        rewards[agent, GAME] = 1.0
        rewards[1 - agent, GAME] = -1.0
    for i in range(2):
        if is_won or is_full:
            terminated[i] = True
            s.ending[i] = WON if is_won else DRAWN


@rule
def observe(s, agent, obs):  # type: ignore[no-untyped-def]  # likewise
    """Shows the own marks, and the other's (R6)."""
    rows, columns = obs.observation.shape[0], obs.observation.shape[1]
    for row in range(rows):
        for column in range(columns):
            mark = s.board[row * columns + column]
            obs.observation[row, column, 0] = mark == agent + 1
            obs.observation[row, column, 1] = mark == 2 - agent


@rule
def mask(s, agent, flags):  # type: ignore[no-untyped-def]  # likewise
    """Shows legal actions to the player in turn, or in its last turn (R6)."""
    is_shown = agent == s.turn or s.live[agent] == 0
    for action in range(len(flags)):
        flags[action] = is_shown and s.board[action] == 0


@rule
def overview(s, state):  # type: ignore[no-untyped-def]  # likewise
    """Shows the whole board."""
    for row in range(state.shape[0]):
        for column in range(state.shape[1]):
            state[row, column] = s.board[row * state.shape[1] + column]


def board_kernel(
    metadata: Mapping[str, Any],
    agents: tuple[str, str],
    shape: tuple[int, int],
    actions: int,
    act: Any,
    *,
    more: tuple[Field, ...] = (),
) -> Kernel:
    """Returns the kernel of a board game; `more` are fields of the state beside the board."""
    seen, legal = Box(0, 1, (*shape, 2), np.int8), Box(0, 1, (actions,), np.int8)
    return Kernel(
        name=metadata["name"],
        agents=agents,
        observation_space=Dict({"observation": seen, "action_mask": legal}),
        action_space=Discrete(actions),
        state=[("board", "i1", (shape[0] * shape[1],)), *more],
        reset=reset,
        act=act,
        observe=observe,
        mask=mask,
        plays_illegal=True,
        overview=overview,
        state_space=Box(0, 2, shape, np.int8),
        terms=("game", "illegal"),
        endings=("won", "drawn", "illegal"),
        metadata=metadata,
    )


def lazy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Takes the first legal action."""
    return int(observation["action_mask"].argmax())


class BoardGame(Pictured, MaskedTurns):
    """Environment of a board game; a game adds its kernel, policies and pixels."""

    def first_to_leave(self) -> Any:
        """Agent whose turn it would be (R7)."""
        return self.next_agent(self.agent_selection)

    def board(self) -> NDArray[np.int8]:
        """Marks by row and column: 0 free, 1 the first player's, 2 the second's."""
        return np.asarray(self.memory.records["board"][0].reshape(self.state_space.shape))

    def letters(self) -> str:
        """Board in letters: `X` the first player's marks, `O` the second's."""
        return text_of([LETTERS[mark] for mark in row] for row in self.board())
