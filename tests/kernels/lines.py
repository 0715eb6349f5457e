"""A kernel that is a few lines long: two robots on a line, with wind that is drawn."""

import numpy as np
from gymnasium import spaces

from gamekeeper.kernels import draws
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import rule

LAST = 4


@rule
def reset(s):
    """Both at their ends."""
    s.cells[0] = 0
    s.cells[1] = LAST


@rule
def step(s, actions, rewards, terminated, truncated):
    """Moves, wind, a meeting, a fall."""
    for i in range(2):
        if s.live[i] != 0:
            wind = draws.integers(s, 4) == 0
            move = 0 if wind else actions[i] - 1
            s.cells[i] = min(max(s.cells[i] + move, 0), LAST)
    if s.live[1] != 0 and s.cells[0] == s.cells[1]:
        for i in range(2):
            rewards[i, 0] = 1.0
            terminated[i] = True
    elif s.live[1] != 0 and draws.uniform(s, 0.0, 1.0) < 0.05:
        terminated[1] = True
        rewards[1, 1] = -0.5


@rule
def observe(s, obs):
    """The own cell."""
    for i in range(2):
        obs[i, 0] = s.cells[i]


@rule
def mask(s, masks):
    """No move beyond the line."""
    for i in range(2):
        masks[i, 0] = s.cells[i] > 0
        masks[i, 1] = 1
        masks[i, 2] = s.cells[i] < LAST


WINDY = Kernel(
    name="windy_line_v0",
    agents=("picker", "carrier"),
    observation_space=spaces.Box(0, LAST, (1,), np.int64),
    action_space=spaces.Discrete(3),
    state=[("cells", "i8", (2,))],
    reset=reset,
    step=step,
    observe=observe,
    mask=mask,
    plays_illegal=True,
    terms=("meeting", "fall"),
    horizon=30,
)
