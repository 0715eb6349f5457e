"""A kernel of turns that is a few lines long: who draws the last of some sticks wins."""

import numpy as np
from gymnasium import spaces

from gamekeeper.kernels import draws
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import rule

MOST = 12


@rule
def reset(s):
    """6 to 12 sticks."""
    s.sticks[0] = 6 + draws.integers(s, MOST - 5)


@rule
def act(s, agent, action, rewards, terminated, truncated):
    """One to three sticks are drawn."""
    s.sticks[0] -= action + 1
    s.turn = 1 - agent
    if s.sticks[0] == 0:
        for i in range(2):
            rewards[i, 0] = 1.0 if i == agent else -1.0
            terminated[i] = True


@rule
def observe(s, agent, obs):
    """How many are left, and who looks."""
    obs.left[0] = s.sticks[0]
    obs.me[0] = agent


@rule
def mask(s, agent, masks):
    """No more than there are."""
    for k in range(3):
        masks[k] = 1 if s.sticks[0] > k else 0


STICKS = Kernel(
    name="sticks_v0",
    agents=("player_0", "player_1"),
    observation_space=spaces.Dict(
        {
            "action_mask": spaces.Box(0, 1, (3,), np.int8),
            "left": spaces.Box(0, MOST, (1,), np.int64),
            "me": spaces.Box(0, 1, (1,), np.float32),
        }
    ),
    action_space=spaces.Discrete(3),
    state=[("sticks", "i4", (1,))],
    reset=reset,
    act=act,
    observe=observe,
    mask=mask,
)
