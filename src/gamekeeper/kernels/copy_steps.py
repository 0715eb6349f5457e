"""The driver of kernels in which all agents act at once."""

from typing import Any

from gamekeeper.kernels.rule_parts import HORIZON, UNNAMED, Parts
from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.randomness.seeds import INIT_B, MIX_R, MULT_A, MULT_B, WORD


def begin_one(parts: Parts) -> Any:
    """`begin(s, t, a, pool, constant)`: begins the episode whose number stands in `s`."""
    reset, seed_of = parts.rule("reset"), parts.own(episode_seed)
    count, is_aec = len(parts.kernel.agents), parts.kernel.api == "aec"

    def begin(s: Any, t: Any, a: Any, pool: Any, constant: Any) -> None:
        # `raw` is the whole record as words: one loop clears every field of the state, those of the
        # rules too, whatever they are called. Number and limit outlive the episode.
        number, limit = s.number, s.limit
        for i in range(len(a.raw)):
            a.raw[i] = 0
        s.number = number
        s.limit = limit
        s.seed = seed_of(pool, constant, number)
        s.block = -1  # the words that stand beside are of no block yet: the first draw makes one
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
                # `live` is still that of before the step, so an agent is judged once, in the step
                # that ended it; an ending by the rules goes before one by the horizon.
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


def driver_of_one(parts: Parts) -> tuple[Any, Any]:
    """The functions that begin an episode of one copy, and play one tick or turn of it."""
    is_aec, count = parts.kernel.api == "aec", len(parts.kernel.agents)
    play = turn_player(parts) if is_aec else tick_player(parts)
    show = turn_shower(parts) if is_aec else tick_shower(parts)
    note = _turn_note(parts) if is_aec else _tick_note(parts)
    begin, clear = begin_one(parts), clear_books(parts)

    def step(
        s: Any,
        t: Any,
        a: Any,
        over: Any,
        pool: Any,
        constant: Any,
        slots: Any,
        is_next: Any,
        tells: Any,
    ) -> Any:
        """Returns 0 where it goes on, 1 where an episode ended, and 2 more where it is over."""
        # The order matters. `note` keeps what ended agents saw last before `begin` overwrites the
        # state; `show` comes last, over the state of whichever episode is current by then, so that
        # an autoreset in the same step hands out the first observation of the next episode.
        clear(a)
        end = 0
        begins = over  # next_step: this step resets, and no action is taken
        if not over:
            left = play(s, t, a)
            note(s, t, a, left)
            if left == 0:
                begins = not is_next
                end = 1 if begins else 3
        if begins:
            s.number += slots
            begin(s, t, a, pool, constant)
        for i in range(count):
            a.live[i] = s.live[i] != 0
        # called at one place only: the rules are inlined here, and each place compiles them anew
        show(s, t, a, tells, end == 3 if is_aec else not begins)
        return end

    return first_one(parts, begin, show), parts.made(step)


def _tick_note(parts: Parts) -> Any:
    """`note(s, t, a, left)`: of a tick that ended some, what all were given last."""
    keep, count = _tick_keeper(parts), len(parts.kernel.agents)

    def note(s: Any, t: Any, a: Any, left: Any) -> None:
        # Most ticks end no agent; only one that does pays for a second look at the observations.
        has_ended = left == 0
        for i in range(count):
            has_ended = has_ended or a.terminated[i] or a.truncated[i]
        if has_ended:
            for i in range(count):
                a.last[i] = a.live[i] or a.terminated[i] or a.truncated[i] or s.live[i] != 0
            keep(s, t, a)

    return parts.made(note)


def _turn_note(parts: Parts) -> Any:
    """`note(s, t, a, left)`: of a turn, what those that it ended were given last."""
    keep, count = turn_keeper(parts), len(parts.kernel.agents)

    def note(s: Any, t: Any, a: Any, left: Any) -> None:
        for i in range(count):
            a.last[i] = s.ending[i] != 0
            if a.terminated[i] or a.truncated[i]:
                keep(s, t, a, i)

    return parts.made(note)


def tick_player(parts: Parts) -> Any:
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


def tick_shower(parts: Parts) -> Any:
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


def _tick_keeper(parts: Parts) -> Any:
    """`keep(s, t, a)`: what those who lived into this tick, which ended some of them, are given."""
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


def turn_player(parts: Parts) -> Any:
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
        # `acted`: agents that had a turn in this tick. `due`: agents of its beginning that still
        # wait for one; those that ended in the meantime wait for nothing.
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


def turn_shower(parts: Parts) -> Any:
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


def turn_keeper(parts: Parts) -> Any:
    """`keep(s, t, a, i)`: what agent i, that has just ended, is given last."""
    observe, mask, inform = (parts.rule(name) for name in ("observe", "mask", "inform"))
    place = parts.row

    def keep(s: Any, t: Any, a: Any, i: Any) -> None:
        observe(s, t, i, place(a.final, i))
        mask(s, t, i, place(a.final_masks, i))
        inform(s, t, i, place(a.final_infos, i)[()])

    return parts.made(keep)


@rule
def episode_seed(pool, constant, episode):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The seed of episode `episode`, below 2**32, of the run whose `EpisodeSeeds` these are of."""
    # The last round of SeedSequence's hash, by hand: `constant` is its multiplier after all rounds
    # that the run's episodes share, `pool` the word that they left (see `EpisodeSeeds`). WORD cuts
    # to 32 bits, as C does by itself; the last shift keeps the seed below 2**31.
    value = (episode ^ constant) * (constant * MULT_A & WORD) & WORD
    value = (pool - (MIX_R * (value ^ (value >> 16)) & WORD)) & WORD
    value = ((value ^ (value >> 16)) ^ INIT_B) * (INIT_B * MULT_B & WORD) & WORD
    return (value ^ (value >> 16)) >> 1
