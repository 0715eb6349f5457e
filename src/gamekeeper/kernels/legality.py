"""Actions are looked at before any rule indexes by them: compiled rules check nothing."""

from typing import Any, NoReturn

import numpy as np
from gymnasium import spaces

from gamekeeper.errors import ActionError
from gamekeeper.kernels.array_views import plain_row
from gamekeeper.kernels.kernel import Kernel, KernelGroup
from gamekeeper.kernels.kernel_arrays import Arrays
from gamekeeper.kernels.rule_parts import Parts


def judge_one(parts: Parts) -> Any:
    """`judge(a, over)`: whether all that is done in one copy is legal.

    An action of a live agent lies in its space, and isn't masked out unless the rules say what
    becomes of it then. A copy that is over takes no action.
    """
    judge: Any = parts.made(_fine)
    for g, group in enumerate(parts.kernel.groups):
        legal = parts.made(_legal(parts.kernel, group))
        place = g if len(parts.kernel.groups) > 1 else None
        judge = parts.made(_also(judge, legal, place))
    return judge


def _fine(a: Any, over: Any) -> bool:
    return True


def _also(before: Any, legal: Any, g: int | None) -> Any:
    if g is None:

        def judge(a: Any, over: Any) -> Any:
            return before(a, over) & legal(a.actions, a.masks, a.live, over)

    else:

        def judge(a: Any, over: Any) -> Any:
            return before(a, over) & legal(a.actions[g], a.masks[g], a.live, over)

    return judge


def _legal(kernel: Kernel, group: KernelGroup) -> Any:
    """`legal(actions, masks, live, over)` of a group's agents; of turns, of the one in turn."""
    space: Any = group.action_space
    is_masked = kernel.flags(group) > 0 and not kernel.plays_illegal
    if isinstance(space, spaces.Discrete):
        one = _one_turn if kernel.api == "aec" else _one_tick
        return one(group, int(space.start), int(space.n), is_masked)
    if isinstance(space, spaces.MultiDiscrete):
        many = _many_turn if kernel.api == "aec" else _many_tick
        return many(group, np.asarray(space.start, "i8"), np.asarray(space.nvec, "i8"), is_masked)

    def legal(actions: Any, masks: Any, live: Any, over: Any) -> bool:
        return True

    return legal


def _one_tick(group: KernelGroup, start: int, n: int, is_masked: bool) -> Any:
    first, count = group.first, group.count

    def legal(actions: Any, masks: Any, live: Any, over: Any) -> Any:
        is_fine = True
        for i in range(count):
            action = actions[i] - start
            is_in = (action >= 0) & (action < n)
            if is_masked and is_in:
                is_in = masks[i, action] != 0
            is_fine &= is_in | (not live[first + i])
        return is_fine

    return legal


def _one_turn(group: KernelGroup, start: int, n: int, is_masked: bool) -> Any:
    def legal(actions: Any, masks: Any, live: Any, over: Any) -> Any:
        action = actions[()] - start
        is_in = (action >= 0) & (action < n)
        if is_masked and is_in:
            is_in = masks[action] != 0
        return is_in | over

    return legal


def _many_tick(group: KernelGroup, start: Any, nvec: Any, is_masked: bool) -> Any:
    first, count, parts = group.first, group.count, len(nvec)
    at = np.cumsum(nvec) - nvec

    def legal(actions: Any, masks: Any, live: Any, over: Any) -> Any:
        is_fine = True
        for i in range(count):
            for k in range(parts):
                action = actions[i, k] - start[k]
                is_in = (action >= 0) & (action < nvec[k])
                if is_masked and is_in:
                    is_in = masks[i, at[k] + action] != 0
                is_fine &= is_in | (not live[first + i])
        return is_fine

    return legal


def _many_turn(group: KernelGroup, start: Any, nvec: Any, is_masked: bool) -> Any:
    parts = len(nvec)
    at = np.cumsum(nvec) - nvec

    def legal(actions: Any, masks: Any, live: Any, over: Any) -> Any:
        is_fine = True
        for k in range(parts):
            action = actions[k] - start[k]
            is_in = (action >= 0) & (action < nvec[k])
            if is_masked and is_in:
                is_in = masks[at[k] + action] != 0
            is_fine &= is_in | over
        return is_fine

    return legal


def refuse(kernel: Kernel, arrays: Arrays) -> NoReturn:
    """Raises for the first action that isn't legal.

    Raises:
        ActionError: names the copy, the agent, its action and what was legal.
    """
    is_aec, parts = kernel.api == "aec", Parts(kernel, is_plain=True)
    for e in range(len(arrays.live)):
        a, over = plain_row(arrays, e), bool(arrays.over[e])
        if judge_one(parts)(a, over):
            continue
        for g, group in enumerate(kernel.groups):
            one = KernelGroup(0, 1, group.observation_space, group.action_space)
            legal = _legal(kernel, one)
            actions = a.actions[g] if isinstance(a.actions, tuple) else a.actions
            masks = a.masks[g] if isinstance(a.masks, tuple) else a.masks
            for k in range(1 if is_aec else group.count):
                mine = slice(None) if is_aec else slice(k, k + 1)
                live = a.live[group.first + k : group.first + k + 1]
                if legal(actions[mine] if actions.ndim else actions, masks[mine], live, over):
                    continue
                i = int(arrays.turn[e]) if is_aec else group.first + k
                action, flags = (actions, masks) if is_aec else (actions[k], masks[k])
                _raise(kernel, group, e, i, action, flags)
    raise AssertionError("all actions are legal")  # compiled and plain judges differ: a bug of ours


def _raise(kernel: Kernel, group: KernelGroup, e: int, i: int, action: Any, flags: Any) -> NoReturn:
    legal = f", mask {np.asarray(flags)}" if kernel.flags(group) else ""
    raise ActionError(
        "an action isn't legal",
        where=f"copy {e}, agent {kernel.agents[i]!r}",
        expected=f"one of {group.action_space}{legal}",
        actual=str(action),
        fix="choose among the actions that the mask allows",
    )
