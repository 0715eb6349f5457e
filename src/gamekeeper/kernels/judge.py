"""Actions are looked at before any rule indexes by them: compiled rules check nothing."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.kernels.cache import compiled
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.rules import numba

FINE: Final = -1


def judge_of(kernel: Kernel, *, is_plain: bool = False) -> Any:
    """`judge(actions, masks, live, over)` of one group of agents, [copy, agent].

    It returns the place (copy * agents + agent) of the first action of a live agent that is out of
    its space, or masked out where the rules don't say what then; FINE where there is none. Of turns
    there is one agent, [copy]. A function for each group.
    """
    is_plain = is_plain or numba() is None
    functions = []
    for group in kernel.groups:
        is_masked = kernel.flags(group) > 0 and not kernel.plays_illegal
        function = _judge(group.action_space, is_masked=is_masked)
        functions.append(function if is_plain else compiled(function, kernel.name))
    return functions


def _judge(space: spaces.Space[Any], *, is_masked: bool) -> Any:
    if isinstance(space, spaces.Discrete):
        return _of_one(int(space.start), int(space.n), is_masked=is_masked)
    if isinstance(space, spaces.MultiDiscrete):
        return _of_many(np.asarray(space.start), np.asarray(space.nvec), is_masked=is_masked)

    def fine(actions: Any, masks: Any, live: Any, over: Any) -> int:
        return FINE

    return fine


def _of_one(start: int, n: int, *, is_masked: bool) -> Any:
    def judge(actions: Any, masks: Any, live: Any, over: Any) -> int:
        envs, agents = live.shape
        for e in range(envs):
            if over[e]:
                continue
            for i in range(agents):
                if live[e, i]:
                    action = actions[e, i] - start
                    if action < 0 or action >= n or (is_masked and masks[e, i, action] == 0):
                        return int(e * agents + i)
        return FINE

    return judge


def _of_many(start: Any, nvec: Any, *, is_masked: bool) -> Any:
    first = np.cumsum(nvec) - nvec
    count = len(nvec)

    def judge(actions: Any, masks: Any, live: Any, over: Any) -> int:
        envs, agents = live.shape
        for e in range(envs):
            if over[e]:
                continue
            for i in range(agents):
                if live[e, i]:
                    for k in range(count):
                        action = actions[e, i, k] - start[k]
                        if action < 0 or action >= nvec[k]:
                            return int(e * agents + i)
                        if is_masked and masks[e, i, first[k] + action] == 0:
                            return int(e * agents + i)
        return FINE

    return judge
