"""Small kernels with all that the kernel engine has to cope with."""

from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.kernels import draws
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import kernel_env
from gamekeeper.kernels.scalar_rules import rule
from tests.kernels.lines import WINDY

INFO = [("calls", "i8"), ("mood", "f4"), ("at", "f8", (2,)), ("is_up", "?")]


# -- ticks: scouts who come late and leave early, a cook with other spaces; masks in observations


@rule
def camp_reset(s):
    """The third scout comes later; the first leaves early."""
    s.live[2] = 0
    s.leaves = 2 + draws.integers(s, 4)
    s.comes = 1 + draws.integers(s, 5)
    for i in range(4):
        s.at[i] = draws.integers(s, 5)


@rule
def camp_step(s, actions, rewards, terminated, truncated):
    """Pays by what was done; one leaves, one comes, and is paid for it."""
    scouts, cooks = actions
    for i in range(3):
        if s.live[i] != 0:
            s.at[i] = (s.at[i] + scouts[i] + draws.integers(s, 2)) % 9
            rewards[i, 0] = s.at[i] * 0.1
            rewards[i, 1] = -0.5 * (s.at[i] % 2)
    if s.live[3] != 0:
        s.at[3] = (s.at[3] + cooks[0, 0] + cooks[0, 1]) % 9
        rewards[3, 0] = s.at[3] * 1.0
    if s.time == s.leaves and s.live[0] != 0:
        terminated[0] = True
        s.ending[0] = 1
    if s.time == s.comes:
        s.live[2] = 1
        if s.at[3] % 2 == 0:
            rewards[2, 1] = 0.25
    if s.live[3] != 0 and draws.uniform(s, 0.0, 1.0) < 0.1:
        truncated[3] = True
        s.ending[3] = 2 if s.time % 2 == 0 else 0
    if s.time >= 5 + s.leaves:
        for i in range(4):
            if s.live[i] != 0 and not truncated[i]:
                if i == 1:
                    terminated[i] = True
                truncated[i] = i != 1


@rule
def camp_observe(s, obs):
    """Dictionaries for scouts, bytes for the cook."""
    scouts, cooks = obs
    for i in range(3):
        scouts.at[i, 0] = s.at[i]
        scouts.at[i, 1] = s.time * 0.5
        scouts.n[i] = s.at[i] % 9
    cooks[0, 0] = s.at[3]
    cooks[0, 1] = s.time
    cooks[0, 2] = 255


@rule
def camp_mask(s, masks):
    """Not all is always legal."""
    scouts, cooks = masks
    for i in range(3):
        scouts[i, 0] = 1
        scouts[i, 1] = s.at[i] % 2
        scouts[i, 2] = 1
    cooks[0, 0] = 1
    cooks[0, 1] = 1
    cooks[0, 2] = 1
    cooks[0, 3] = s.at[3] % 2
    cooks[0, 4] = 1


@rule
def camp_inform(s, infos):
    """Whole numbers, single precision, an array, a flag."""
    for i in range(4):
        infos[i].calls = s.time - 3
        infos[i].mood = s.at[i] * 0.1
        infos[i].at[0] = s.at[i] / 3.0
        infos[i].at[1] = math_of(s.at[i])
        infos[i].is_up = s.at[i] > 4


@rule
def math_of(number):
    """No number now and then, and no small one."""
    if number == 7:
        return np.nan
    if number == 8:
        return np.inf
    return number * 1e17


@rule
def camp_overview(s, state):
    """Where all are."""
    for i in range(4):
        state[i] = s.at[i]
    state[4] = s.time


SCOUT = spaces.Dict(
    {
        "n": spaces.Discrete(9),
        "at": spaces.Box(-9, 99, (2,), np.float32),
        "action_mask": spaces.Box(0, 1, (3,), np.int8),
    }
)
COOK = spaces.Box(0, 255, (3,), np.uint8)
CAMP_AGENTS = ("scout_0", "scout_1", "scout_2", "cook")
CAMP = Kernel(
    name="camp_v0",
    agents=CAMP_AGENTS,
    observation_space=dict.fromkeys(CAMP_AGENTS[:3], SCOUT) | {"cook": COOK},
    action_space=dict.fromkeys(CAMP_AGENTS[:3], spaces.Discrete(3))
    | {"cook": spaces.MultiDiscrete([2, 3])},
    state=[("at", "i8", (4,)), ("leaves", "i8"), ("comes", "i8")],
    reset=camp_reset,
    step=camp_step,
    observe=camp_observe,
    mask=camp_mask,
    inform=camp_inform,
    info=INFO,
    overview=camp_overview,
    state_space=spaces.Box(0, 99, (5,), np.int64),
    terms=("catch", "fee"),
    endings=("tired", "fed"),
)


# -- turns: several end in one turn, one joins, others are paid


@rule
def ring_reset(s):
    """The last one joins later."""
    s.live[3] = 0
    s.turn = 0
    s.comes = 2 + draws.integers(s, 4)
    s.sum = draws.integers(s, 3)


@rule
def ring_act(s, agent, action, rewards, terminated, truncated):
    """Pays, ends one or two, goes round."""
    s.sum += action
    rewards[agent, 0] = action * 0.1
    if s.sum % 3 == 0:
        for i in range(4):
            if s.live[i] != 0 and i != agent:
                rewards[i, 1] = 0.5 - action
    if s.time == s.comes:
        s.live[3] = 1
        rewards[3, 1] = 0.125
    if s.sum % 7 == 3:
        terminated[agent] = True
        s.ending[agent] = 1
        other = (agent + 3) % 4
        if s.live[other] != 0 and s.time != s.comes and draws.integers(s, 2) == 0:
            truncated[other] = True
    then = agent
    for _ in range(4):
        then = (then + 1) % 4
        if s.live[then] != 0 and not (terminated[then] or truncated[then]):
            break
    s.turn = then


@rule
def ring_observe(s, agent, obs):
    """The sum, who asks."""
    obs.sum[0] = s.sum
    obs.sum[1] = agent


@rule
def ring_mask(s, agent, flags):
    """One of four is illegal."""
    for k in range(4):
        flags[k] = (s.sum + agent) % 4 != k


@rule
def ring_inform(s, agent, info):
    """As of the camp."""
    info.calls = s.sum
    info.mood = s.sum * 0.1
    info.at[0] = agent / 3.0
    info.at[1] = math_of(s.sum % 9)
    info.is_up = s.sum > 4


@rule
def ring_overview(s, state):
    """The sum."""
    state[0] = s.sum


RING = Kernel(
    name="ring_v0",
    agents=("a", "d", "c", "b"),
    observation_space=spaces.Dict(
        {
            "action_mask": spaces.Box(0, 1, (4,), np.int8),
            "sum": spaces.Box(0, 999, (2,), np.float32),
        }
    ),
    action_space=spaces.Discrete(4),
    state=[("sum", "i8"), ("comes", "i8")],
    reset=ring_reset,
    act=ring_act,
    observe=ring_observe,
    mask=ring_mask,
    inform=ring_inform,
    info=INFO,
    overview=ring_overview,
    state_space=spaces.Box(0, 999, (1,), np.int64),
    terms=("own", "others"),
    endings=("three",),
    horizon=5,
)


# -- continuous actions, no masks


@rule
def glide_reset(s):
    """All at the origin."""


@rule
def glide_step(s, actions, rewards, terminated, truncated):
    """Moves; who is far away has arrived."""
    for i in range(2):
        if s.live[i] != 0:
            s.at[i] += actions[i, 0] * 0.5 + draws.normal(s) * 0.1
            rewards[i, 0] = -abs(s.at[i])
            if s.at[i] > 1.5:
                terminated[i] = True


@rule
def glide_observe(s, obs):
    """Where one is."""
    for i in range(2):
        obs[i, 0] = s.at[i]


GLIDE = Kernel(
    name="glide_v0",
    agents=("a", "b"),
    observation_space=spaces.Box(-np.inf, np.inf, (1,), np.float64),
    action_space=spaces.Box(-1.0, 1.0, (2,), np.float32),
    state=[("at", "f8", (2,))],
    reset=glide_reset,
    step=glide_step,
    observe=glide_observe,
    horizon=12,
)


def glide(*, debug: bool = False) -> Any:
    """Ticks, continuous actions, neither masks nor infos nor states."""
    return kernel_env(GLIDE, debug=debug)


def windy(*, debug: bool = False) -> Any:
    """Ticks, one kind of agents, masks in infos, actions played though they are masked out."""
    return kernel_env(WINDY, debug=debug)


def camp(*, debug: bool = False) -> Any:
    """Ticks, two kinds of agents."""
    return kernel_env(CAMP, debug=debug)


def ring(*, debug: bool = False) -> Any:
    """Turns."""
    return kernel_env(RING, debug=debug)
