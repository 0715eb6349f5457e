"""Drivers: what runs a kernel's rules over many copies, compiled or as plain Python.

Per-agent ends, horizon, autoreset and seeds are here, once; a kernel has only rules.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gamekeeper.kernels.kernel import Copy, Kernel
from gamekeeper.kernels.rows import row
from gamekeeper.kernels.rules import OPTIONS, Plain, as_python, key_of, numba
from gamekeeper.kernels.seeding import episode_seed

NO_HORIZON: Final = 1 << 62


@dataclass(frozen=True)
class Driver:
    """Two functions over arrays by copy; see `built`."""

    begin: Any
    """begin(records, obs, masks, live, run, high, first): every copy starts its first episode."""
    step: Any
    """step(records, actions, obs, masks, rewards, terms, terminated, truncated, live, over, final,
    run, high, slots, is_next): one step of every copy."""


def built(kernel: Kernel, *, is_plain: bool = False) -> Driver:
    """The driver of a kernel: compiled where Numba is there, unless plain Python is asked for."""
    parts = _Parts(kernel, is_plain=is_plain or numba() is None)
    begin_one, step_one = _one_copy(kernel, parts)

    def begin(
        records: Any, obs: Any, masks: Any, live: Any, run: Any, high: Any, first: Any
    ) -> None:
        for e in range(len(records)):
            s = records[e]
            s.number = first + e
            begin_one(s, row(obs, e), row(masks, e), row(live, e), run, high)

    def step(
        records: Any,
        actions: Any,
        obs: Any,
        masks: Any,
        rewards: Any,
        terms: Any,
        terminated: Any,
        truncated: Any,
        live: Any,
        over: Any,
        final: Any,
        run: Any,
        high: Any,
        slots: Any,
        is_next: Any,
    ) -> None:
        for e in range(len(records)):
            over[e] = step_one(
                records[e], row(actions, e), row(obs, e), row(masks, e), row(rewards, e),
                row(terms, e), row(terminated, e), row(truncated, e), row(live, e), over[e],
                row(final, e), run, high, slots, is_next,
            )  # fmt: skip

    if parts.is_plain:
        return _plain_driver(begin_one, step_one)
    key = key_of(kernel.reset) + key_of(kernel.step) + key_of(kernel.observe)
    return Driver(*(_cached(parts.made(each), key + repr(kernel.dtype)) for each in (begin, step)))


@dataclass(frozen=True)
class _Parts:
    """A kernel's rules in the form that its driver calls."""

    kernel: Kernel
    is_plain: bool

    def rule(self, function: Any) -> Any:
        """A rule, or its plain twin."""
        return as_python(function) if self.is_plain else function

    def made(self, function: Any) -> Any:
        """A function of the driver's, compiled unless plain."""
        return function if self.is_plain else numba().njit(function, **OPTIONS)


def _one_copy(kernel: Kernel, parts: _Parts) -> tuple[Any, Any]:
    """What begins an episode of one copy, and what steps one."""
    shown, shown_last = _viewers(kernel, parts)
    begun = _beginner(kernel, parts, shown)
    rules_step, observe = parts.rule(kernel.step), parts.rule(kernel.observe)
    cleared, settled = _books(kernel, parts)
    count = len(kernel.agents)

    def step_one(
        s: Any,
        actions: Any,
        obs: Any,
        masks: Any,
        rewards: Any,
        terms: Any,
        terminated: Any,
        truncated: Any,
        live: Any,
        over: Any,
        final: Any,
        run: Any,
        high: Any,
        slots: Any,
        is_next: Any,
    ) -> Any:
        cleared(rewards, terms, terminated, truncated)
        if over:  # next_step: this step resets, and no action is taken
            s.number += slots
            begun(s, obs, masks, live, run, high)
            return False
        rules_step(s, actions, terms, terminated, truncated)
        is_over = settled(s, rewards, terms, terminated, truncated) == 0
        if is_over:
            observe(s, final)
            for i in range(count):
                if s.live[i] == 0:
                    final[i] = 0
            if not is_next:
                s.number += slots
                begun(s, obs, masks, live, run, high)
                return False
        for i in range(count):
            if terminated[i] or truncated[i]:
                s.live[i] = 0
            live[i] = s.live[i] != 0
        shown_last(s, obs, masks, terminated, truncated)
        return is_over

    return begun, parts.made(step_one)


def _viewers(kernel: Kernel, parts: _Parts) -> tuple[Any, Any]:
    """What shows the living their observations and masks; and, after a step, those who ended."""
    observe, has_mask = parts.rule(kernel.observe), kernel.mask is not None
    mask = parts.rule(kernel.mask) if has_mask else observe
    count = len(kernel.agents)

    def show(s: Any, obs: Any, masks: Any) -> None:
        observe(s, obs)
        if has_mask:
            mask(s, masks)
        for i in range(count):
            if s.live[i] == 0:
                obs[i] = 0
                if has_mask:
                    masks[i] = 0

    def show_last(s: Any, obs: Any, masks: Any, terminated: Any, truncated: Any) -> None:
        observe(s, obs)
        if has_mask:
            mask(s, masks)
        for i in range(count):
            if s.live[i] == 0:
                if not (terminated[i] or truncated[i]):
                    obs[i] = 0
                if has_mask:
                    masks[i] = 0

    return parts.made(show), parts.made(show_last)


def _beginner(kernel: Kernel, parts: _Parts, shown: Any) -> Any:
    """What begins the episode whose number stands in the copy's state."""
    reset, seed_of, count = parts.rule(kernel.reset), parts.rule(episode_seed), len(kernel.agents)

    def begin_one(s: Any, obs: Any, masks: Any, live: Any, run: Any, high: Any) -> None:
        s.seed = seed_of(run, high, s.number)
        s.draws = 0
        s.block = -1
        s.time = 0
        for i in range(count):
            s.live[i] = 1
        reset(s)
        for i in range(count):
            live[i] = s.live[i] != 0
        shown(s, obs, masks)

    return parts.made(begin_one)


def _books(kernel: Kernel, parts: _Parts) -> tuple[Any, Any]:
    """What clears a step's books, and what closes them: horizon, sums, how many live on."""
    count, terms_count = len(kernel.agents), len(kernel.terms)
    horizon = NO_HORIZON if kernel.horizon is None else kernel.horizon

    def clear(rewards: Any, terms: Any, terminated: Any, truncated: Any) -> None:
        for i in range(count):
            rewards[i] = 0.0
            terminated[i] = False
            truncated[i] = False
            for k in range(terms_count):
                terms[i, k] = 0.0

    def settle(s: Any, rewards: Any, terms: Any, terminated: Any, truncated: Any) -> Any:
        s.time += 1
        left = 0
        for i in range(count):
            if s.live[i] != 0:
                if s.time >= horizon and not terminated[i]:
                    truncated[i] = True
                if not (terminated[i] or truncated[i]):
                    left += 1
            for k in range(terms_count):
                rewards[i] += terms[i, k]
        return left

    return parts.made(clear), parts.made(settle)


def _plain_driver(begin_one: Any, step_one: Any) -> Driver:
    """The same loops over copies that plain Python can read."""

    def begin(
        records: Any, obs: Any, masks: Any, live: Any, run: int, high: int, first: int
    ) -> None:
        for e, s in enumerate(copies(records)):
            s.number = first + e
            begin_one(s, *(each[e].view(Plain) for each in (obs, masks, live)), run, high)

    def step(records: Any, *arrays_and_rest: Any) -> None:
        *arrays, over, final, run, high, slots, is_next = arrays_and_rest
        for e, s in enumerate(copies(records)):
            parts = [each[e].view(Plain) for each in arrays]
            over[e] = step_one(
                s, *parts, bool(over[e]), final[e].view(Plain), run, high, slots, is_next
            )

    return Driver(begin, step)


def copies(records: Any) -> list[Copy]:
    """The copies of a batch as plain Python sees them."""
    return [Copy(records[e : e + 1].reshape(())) for e in range(len(records))]


def _cached(dispatcher: Any, key: str) -> Any:
    """Compiled code is kept on disk under a key that doesn't change from process to process.

    Numba's own key is a pickle of the closure, which holds other dispatchers and so never matches.
    A folder that can't be written to only means that it compiles again.
    """
    from numba.core.caching import FunctionCache

    class StableCache(FunctionCache):  # type: ignore[misc]  # numba has no types
        def _index_key(self, signature: Any, codegen: Any) -> Any:
            return (signature, codegen.magic_tuple(), (key, key))

    try:
        dispatcher._cache = StableCache(dispatcher.py_func)
    except RuntimeError:  # no place for a cache
        return dispatcher
    return dispatcher


def arrays_of(kernel: Kernel, envs: int) -> dict[str, np.ndarray[Any, Any]]:
    """The arrays that a driver works on, for so many copies."""
    agents = len(kernel.agents)
    obs, act = kernel.observation_space, kernel.action_space
    shape: tuple[int, ...] = obs.shape or ()
    return {
        "records": np.zeros(envs, kernel.dtype),
        "actions": np.zeros((envs, agents, *(act.shape or ())), act.dtype),
        "obs": np.zeros((envs, agents, *shape), obs.dtype),
        "masks": np.zeros((envs, agents, kernel.flags), np.int8),
        "rewards": np.zeros((envs, agents)),
        "terms": np.zeros((envs, agents, len(kernel.terms))),
        "terminated": np.zeros((envs, agents), bool),
        "truncated": np.zeros((envs, agents), bool),
        "live": np.zeros((envs, agents), bool),
        "over": np.zeros(envs, bool),
        "final": np.zeros((envs, agents, *shape), obs.dtype),
    }
