"""Probe of `state()`."""

import copy
import hashlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.probes.moves import affordable, equal, moves
from gamekeeper.checks.facts.state_facts import (
    LateState,
    StateAnswer,
    StateAnswers,
    StateSpace,
    UsedState,
)
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.layout import agent_name
from gamekeeper.interface.action_mask import for_sample
from gamekeeper.interface.packing import type_name_of
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult

MOST_TURNS: Final = 24
TRIAL_TURNS: Final = (0, 1, 2, 3, 4, 5, 7, 9)
"""Turns at which other actions are tried."""


@probe(
    "state",
    share=1.0,
    plays=lambda session: session.plays(2, runs=4, most_turns=affordable(session, MOST_TURNS)),
)
def state(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """The state, twice at every turn, in a used instance, and after other actions.

    What state() says, beside what its space declares.

    Facts:
        `StateSpace`, `StateAnswers`, `UsedState`, `LateState`.
    """
    env = session.env()
    method = None
    with suppress(Exception):  # a property raises before the first reset, say
        method = getattr(env, "state", None)
    if not callable(method):  # a field of that name is no state()
        yield session.fact(StateSpace(False, None, None, None))
        return
    recorder = StateRecorder(session, env)
    base = session.play(play, env, watch=recorder, state=False)
    if base.failed is not None and play.actions is not None:
        return  # a shorter play that breaks off shows another thing
    answers = recorder.answers
    space = recorder.space
    refused = str(answers[0].failed) if answers else "NotImplementedError"
    is_there = bool(answers) and answers[0].failed is None
    is_there &= space is not None or any(answer.kind != "NoneType" for answer in answers)
    is_there |= space is not None and not refused.startswith("NotImplementedError")
    text, dtype = (None if x is None else str(x) for x in (space, getattr(space, "dtype", None)))
    yield session.fact(StateSpace(is_there, text, getattr(space, "shape", None), dtype))
    if not is_there:
        return
    yield session.fact(StateAnswers(moves=moves(base.episode), answers=answers), field="state")
    if all(answer.digest == answer.again for answer in answers):
        yield from _used(session, base, answers, env)
    yield from _late(session, base, answers, env)


class StateRecorder:
    """Asks for the state twice after the reset and after every step."""

    def __init__(self, session: ProbeSession, env: Any) -> None:
        self.answers: list[StateAnswer] = []
        self._session = session
        self.space = space_of(session, env)

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """One moment."""
        called = self._session.call("state", lambda: env.state())  # it may be gone by now
        answer = form_of(turn, called.value, self.space if called.failed is None else None)
        answer = replace(answer, failed=called.said, over=not env.agents)
        again = _digest(self._session.call("state", lambda: env.state()).value)
        self.answers.append(replace(answer, digest=_digest(called.value), again=again))


def space_of(session: ProbeSession, env: Any) -> Space[Any] | None:
    """The declared space of the state, where there is one."""
    space = session.call("state_space", getattr, env, "state_space", None).value
    return space if isinstance(space, Space) else None


def form_of(turn: int, value: Any, space: Space[Any] | None) -> StateAnswer:
    """Type, dtype and shape of a state, and whether it lies within its space and has a NaN."""
    is_array = isinstance(value, np.ndarray | np.generic)
    return StateAnswer(
        turn=turn,
        failed=None,
        kind=type_name_of(type(value)),
        dtype=value.dtype.name if is_array else None,
        shape=list(value.shape) if is_array else None,
        is_within=None if space is None else _is_within(value, space),
        has_nan=bool(is_array and value.dtype.kind == "f" and np.isnan(value).any()),
    )


def _is_within(value: Any, space: Space[Any]) -> bool | None:
    """Tells whether it is in the space but for dtype and shape, which are judged apart."""
    low, high = getattr(space, "low", None), getattr(space, "high", None)
    if low is None or high is None:
        return bool(space.contains(value))
    if not isinstance(value, np.ndarray) or value.shape != space.shape or value.dtype.kind in "OUS":
        return None
    return bool((value >= low).all() and (value <= high).all())


def _digest(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.dtype != object:
        head = f"{value.dtype}{value.shape}".encode()
        return hashlib.blake2b(head + value.tobytes(), digest_size=16).hexdigest()
    return hashlib.blake2b(to_json(value).encode(), digest_size=16).hexdigest()


def _used(
    session: ProbeSession, base: EpisodeResult, answers: list[StateAnswer], env: Any
) -> Iterator[Saw]:
    """The same episode once more in the same instance; looked at where all else is equal."""
    again = StateRecorder(session, env)
    used = session.play(base.play, env, watch=again, state=False)
    if session.divergence(base.episode, used.episode) is None:
        pairs = zip(answers, again.answers, strict=False)
        turn = next((a.turn for a, b in pairs if a.digest != b.digest), None)
        yield session.fact(UsedState(turn=turn), field="used")


def _late(
    session: ProbeSession, base: EpisodeResult, answers: list[StateAnswer], env: Any
) -> Iterator[Saw]:
    """Other actions at one turn: when do observations show them, and when does the state?"""
    actions = base.play.actions or ()
    digests = {answer.turn: answer.digest for answer in answers}
    trials = at_once = later = 0
    last: tuple[int | None, dict[Any, Any] | None] = None, None
    for turn in TRIAL_TURNS:
        if turn + 1 >= len(actions):
            break
        other = _others(env, base.episode, turn, actions[turn], seed=session.seed)
        tried = (*actions[:turn], other, actions[turn + 1])
        watch = StateRecorder(session, env)
        played = session.play(
            replace(base.play, actions=tried, most_turns=len(tried)), env, watch=watch, state=False
        )
        if not _parts_at(base.episode, played.episode, turn + 1):
            continue
        now = {answer.turn: answer.digest for answer in watch.answers}
        trials += 1
        at_once += now.get(turn + 1) != digests.get(turn + 1)
        is_later = turn + 2 in now and now[turn + 2] != digests.get(turn + 2)
        later += is_later
        last = (turn, other) if is_later else last
    yield session.fact(LateState(trials, at_once, later, *last), field="late")


def _others(
    env: Any, episode: Episode, turn: int, actions: Mapping[Any, Any], *, seed: int
) -> dict[Any, Any]:
    """Other legal actions for all that act at a turn, drawn from copies of their spaces."""
    masks = next((each.masks for each in episode.turns if each.index == turn), {})
    others: dict[Any, Any] = {}
    for agent, action in actions.items():
        others[agent] = action
        if action is None:
            continue
        space = copy.deepcopy(env.action_space(agent))
        space.seed(seed + turn)
        mask = masks.get(agent_name(agent))
        for _ in range(8):
            drawn = space.sample() if mask is None else space.sample(for_sample(space, mask))
            if to_json(drawn) != to_json(action):
                others[agent] = drawn
                break
    return others


def _parts_at(base: Episode, other: Episode, turn: int) -> bool:
    """Tells whether observations are equal before `turn`, and some of those given at it differ."""
    for left, right in zip(base.turns, other.turns, strict=False):
        if left.index > turn or left.index != right.index:
            return False
        seen, now = dict(left.observations), dict(right.observations)
        if seen.keys() != now.keys():
            return False
        if not all(equal(seen[agent], now[agent]) for agent in seen):
            return left.index == turn
    return False
