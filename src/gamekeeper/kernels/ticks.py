"""The driver of kernels in which all agents act at once."""

from __future__ import annotations

from typing import Any

from gamekeeper.kernels.parts import HORIZON, UNNAMED, Parts
from gamekeeper.kernels.seeding import episode_seed


def begin_one(parts: Parts) -> Any:
    """`begin(s, t, a, pool, constant)`: begins the episode whose number stands in `s`."""
    reset, seed_of = parts.rule("reset"), parts.own(episode_seed)
    count, is_aec = len(parts.kernel.agents), parts.kernel.api == "aec"

    def begin(s: Any, t: Any, a: Any, pool: Any, constant: Any) -> None:
        number, limit = s.number, s.limit
        for i in range(len(a.raw)):
            a.raw[i] = 0
        s.number = number
        s.limit = limit
        s.seed = seed_of(pool, constant, number)
        s.block = -1
        for i in range(count):
            s.live[i] = 1
        reset(s, t)
        if is_aec:
            for i in range(count):
                s.due[i] = s.live[i]

    return parts.made(begin)


def first_one(parts: Parts, begin: Any, show: Any) -> Any:
    """`first(s, t, a, pool, constant, tells)`: begins an episode, and shows it."""
    count = len(parts.kernel.agents)

    def first(s: Any, t: Any, a: Any, pool: Any, constant: Any, tells: Any) -> None:
        begin(s, t, a, pool, constant)
        for i in range(count):
            a.live[i] = s.live[i] != 0
        show(s, t, a, tells, False)

    return parts.made(first)


def clear_books(parts: Parts) -> Any:
    """`clear(a)`: nothing is paid, nobody ended."""
    count, terms = len(parts.kernel.agents), len(parts.kernel.terms)

    def clear(a: Any) -> None:
        for i in range(count):
            a.rewards[i] = 0.0
            a.terminated[i] = False
            a.truncated[i] = False
            if terms > 1:
                for k in range(terms):
                    a.terms[i, k] = 0.0

    return parts.made(clear)


def close_books(parts: Parts) -> Any:
    """`close(s, a, limit)`: the horizon, sums; how many live on. `limit`: it is the last tick."""
    count, terms = len(parts.kernel.agents), len(parts.kernel.terms)

    def close(s: Any, a: Any, limit: Any) -> Any:
        left = 0
        for i in range(count):
            if s.live[i] != 0:
                if a.terminated[i] or a.truncated[i]:
                    if s.ending[i] == 0:
                        s.ending[i] = UNNAMED
                elif limit:
                    a.truncated[i] = True
                    s.ending[i] = HORIZON
                else:
                    left += 1
            if terms > 1:
                for k in range(terms):
                    a.rewards[i] += a.terms[i, k]
            else:
                a.rewards[i] += 0.0  # a sum, too, is never -0.0
        return left

    return parts.made(close)


def tick_driver(parts: Parts) -> tuple[Any, Any]:
    """What begins an episode of one copy, and what plays one tick of it."""
    show, keep, play = shower(parts), _keeper(parts), player(parts)
    begin, clear = begin_one(parts), clear_books(parts)
    count = len(parts.kernel.agents)

    def step(
        s: Any, t: Any, a: Any, over: Any,
        pool: Any, constant: Any, slots: Any, is_next: Any, tells: Any,
    ) -> Any:  # fmt: skip
        """Returns 0 where it goes on, 1 where an episode ended, and 2 more where it is over."""
        clear(a)
        end = 0
        begins = over  # next_step: this step resets, and no action is taken
        if not over and play(s, t, a) == 0:
            for i in range(count):
                a.last[i] = a.live[i] or a.terminated[i] or a.truncated[i]
            keep(s, t, a)
            begins = not is_next
            end = 1 if begins else 3
        if begins:
            s.number += slots
            begin(s, t, a, pool, constant)
        for i in range(count):
            a.live[i] = s.live[i] != 0
        show(s, t, a, tells, not begins)  # at one place, since rules are compiled into it
        return end

    return first_one(parts, begin, show), parts.made(step)


def player(parts: Parts) -> Any:
    """`play(s, t, a)`: the rules of a tick; who ended isn't live after it. How many are left."""
    rules, close = parts.rule("step"), close_books(parts)
    count, is_timed = len(parts.kernel.agents), parts.is_timed

    def play(s: Any, t: Any, a: Any) -> Any:
        s.time += 1
        rules(s, t, a.actions, a.terms, a.terminated, a.truncated)
        left = close(s, a, is_timed and s.time >= s.limit)
        for i in range(count):
            if a.terminated[i] or a.truncated[i]:
                s.live[i] = 0
        return left

    return parts.made(play)


def shower(parts: Parts) -> Any:
    """`show(s, t, a, tells, is_after)`: what everybody is given; zeros for who isn't there.

    Who ended in the tick that was just played (`is_after`) still sees its outcome; and its mask,
    which is a part of infos, where these are told.
    """
    observe, mask, inform = (parts.rule(name) for name in ("observe", "mask", "inform"))
    blank, blank_mask, count = parts.blank(), parts.blank_mask(), len(parts.kernel.agents)

    def show(s: Any, t: Any, a: Any, tells: Any, is_after: Any) -> None:
        observe(s, t, a.obs)
        mask(s, t, a.masks)
        if tells:
            inform(s, t, a.infos)
        for i in range(count):
            if s.live[i] == 0:
                sees = is_after and (a.terminated[i] or a.truncated[i])
                if not sees:
                    blank(a.obs, i)
                if not (sees and tells):
                    blank_mask(a.masks, i)

    return parts.made(show)


def _keeper(parts: Parts) -> Any:
    """`keep(s, t, a)`: what those who lived into this tick, the episode's last, are given."""
    observe, mask, inform = (parts.rule(name) for name in ("observe", "mask", "inform"))
    blank, blank_mask, count = parts.blank(), parts.blank_mask(), len(parts.kernel.agents)

    def keep(s: Any, t: Any, a: Any) -> None:
        observe(s, t, a.final)
        mask(s, t, a.final_masks)
        inform(s, t, a.final_infos)
        for i in range(count):
            if not a.last[i]:
                blank(a.final, i)
                blank_mask(a.final_masks, i)

    return parts.made(keep)
