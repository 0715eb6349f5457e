"""The driver of kernels in which agents take turns."""

from __future__ import annotations

from typing import Any

from gamekeeper.kernels.parts import Parts
from gamekeeper.kernels.ticks import begin_one, clear_books, close_books, first_one


def turn_driver(parts: Parts) -> tuple[Any, Any]:
    """What begins an episode of one copy, and what plays one turn of it."""
    show, keep, play = shower(parts), keeper(parts), player(parts)
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
        if not over:
            left = play(s, t, a)
            for i in range(count):
                if a.terminated[i] or a.truncated[i]:
                    keep(s, t, a, i)
            if left == 0:
                for i in range(count):
                    a.last[i] = s.ending[i] != 0
                begins = not is_next
                end = 1 if begins else 3
        if begins:
            s.number += slots
            begin(s, t, a, pool, constant)
        for i in range(count):
            a.live[i] = s.live[i] != 0
        show(s, t, a, tells, end == 3)
        return end

    return first_one(parts, begin, show), parts.made(step)


def player(parts: Parts) -> Any:
    """`play(s, t, a)`: the rules of a turn; who ended isn't live after it. How many are left."""
    rules, close, ended_tick = parts.rule("act"), close_books(parts), _clock(parts)
    action_of = parts.made(_whole if parts.kernel.groups[0].action_space.shape else _number)
    count = len(parts.kernel.agents)

    def play(s: Any, t: Any, a: Any) -> Any:
        s.time += 1
        agent = s.turn
        rules(s, t, agent, action_of(a.actions), a.terms, a.terminated, a.truncated)
        left = close(s, a, ended_tick(s, a, agent))
        for i in range(count):
            if a.terminated[i] or a.truncated[i]:
                s.live[i] = 0
        return left

    return parts.made(play)


def _whole(action: Any) -> Any:
    return action


def _number(action: Any) -> Any:
    return action[()]


def _clear(flags: Any) -> None:
    flags[:] = 0


def _clock(parts: Parts) -> Any:
    """`ended(s, a, agent)`: whether this turn ends the last tick before the horizon.

    A tick is over once all who were live as it began have had a turn or ended, or the turn comes to
    an agent that already had one in it; who joins begins with the next.
    """
    count = len(parts.kernel.agents)

    def ended(s: Any, a: Any, agent: Any) -> Any:
        s.acted[agent] = 1
        s.due[agent] = 0
        is_over = s.acted[s.turn] != 0
        due = 0
        for i in range(count):
            if a.terminated[i] or a.truncated[i]:
                s.due[i] = 0
            due += s.due[i]
        if not (is_over or due == 0):
            return False
        s.ticks += 1
        for i in range(count):
            s.acted[i] = 0
            is_there = s.live[i] != 0 and not (a.terminated[i] or a.truncated[i])
            s.due[i] = 1 if is_there else 0
        return s.ticks == s.limit

    def never(s: Any, a: Any, agent: Any) -> Any:
        return False

    return parts.made(ended if parts.is_timed else never)


def shower(parts: Parts) -> Any:
    """`show(s, t, a, tells, is_over)`: what the agent in turn is given; nothing where all ended."""
    observe, mask, inform = (parts.rule(name) for name in ("observe", "mask", "inform"))
    blank, blank_mask = parts.blank_whole(), parts.made(_clear)

    def show(s: Any, t: Any, a: Any, tells: Any, is_over: Any) -> None:
        if is_over:
            blank(a.obs)
            blank_mask(a.masks)
            return
        agent = s.turn
        a.turn[()] = agent
        observe(s, t, agent, a.obs)
        mask(s, t, agent, a.masks)
        if tells:
            inform(s, t, agent, a.infos[()])

    return parts.made(show)


def keeper(parts: Parts) -> Any:
    """`keep(s, t, a, i)`: what agent i, that has just ended, is given last."""
    observe, mask, inform = (parts.rule(name) for name in ("observe", "mask", "inform"))
    place = parts.row

    def keep(s: Any, t: Any, a: Any, i: Any) -> None:
        observe(s, t, i, place(a.final, i))
        mask(s, t, i, place(a.final_masks, i))
        inform(s, t, i, place(a.final_infos, i)[()])

    return parts.made(keep)
