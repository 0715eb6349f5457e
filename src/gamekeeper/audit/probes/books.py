"""The books of an AEC environment: what `last()` itself tells, what stands in `rewards`, resets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from numbers import Real
from typing import Any, Final

import numpy as np

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.run.episode import Play, Played

SHARE: Final = 1.5
API: Final = "aec"
PLAYS: Final = 3
RUNS: Final = 3
"""A play itself, the one with marks, and the one that a reset cuts."""
MOST_MARKS: Final = 12
"""Crossings of one play before which rewards are marked."""
MARK: Final = 1000.0
"""Added to a reward before a step, times its size and one: no game pays so."""


def plays(lab: Lab) -> Iterator[Play]:
    """A few, of some length each."""
    yield from lab.plays(PLAYS, runs=RUNS)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The trace; then the same play with marked rewards, and once more, cut by a reset.

    Facts:
        `told`: the reward of `last()` at each turn where it is a number, by turn.
        `stands`: before a live agent's step somebody's reward was raised by a mark; {"agent",
            "reward", "after", "stood"}: the reward there was, what was there after the step, and
            whether the mark still stood in it.
        `owed`: after a reset in the midst of an episode in which somebody was owed something:
            {"last", "rewards", "cumulative"}: the reward of `last()`, what isn't 0 in the books.
    """
    env = lab.env()
    told: dict[int, Any] = {}
    paid: list[dict[Any, float]] = []

    def watch(turn: int, env: Any, out: Any) -> None:
        reward = _last(lab, env)
        if reward is not None:
            told[turn] = reward
        paid.append(_book(lab, env, "rewards"))

    played = lab.play(play, env, watch=watch, state=False)
    yield played.trace
    yield lab.fact("told", told, field="received")
    if not any(paid):
        return
    yield from _marks(lab, env, played, paid)
    yield from _owed(lab, env, played, paid)


def _marks(lab: Lab, env: Any, played: Played, paid: list[dict[Any, float]]) -> Iterator[Saw]:
    """Whether what stood in `rewards` before a step is gone after it."""
    live = [turn.index for turn in played.trace.turns
            if turn.order and turn.order[0] not in turn.ended and not turn.raised]  # fmt: skip
    places = [turn for turn in live if turn < len(paid) and paid[turn]][:MOST_MARKS]
    marked: dict[int, dict[Any, float]] = {}
    after: dict[int, dict[Any, float]] = {}

    def watch(turn: int, env: Any, out: Any) -> None:
        if turn - 1 in marked:
            after[turn - 1] = _book(lab, env, "rewards")
        if turn in places:
            marked[turn] = {}
            for agent, reward in _book(lab, env, "rewards").items():
                mark = reward + MARK * (1.0 + abs(reward))
                if lab.call("rewards", _put, env, agent, mark).failed is None:
                    marked[turn][agent] = mark

    if not places:
        return
    lab.play(_cut(played.play, places[-1] + 1), env, watch=watch, state=False)
    for turn in sorted(after.keys() & marked.keys()):
        for agent, mark in marked[turn].items():
            seen = after[turn].get(agent, 0.0)
            natural = paid[turn].get(agent, 0.0)
            value = {"agent": agent, "reward": natural, "after": seen, "stood": seen > mark / 2}
            yield lab.fact("stands", value, turn=turn, agent=agent, field="rewards")


def _owed(lab: Lab, env: Any, played: Played, paid: list[dict[Any, float]]) -> Iterator[Saw]:
    """What is owed after a reset, where the episode before it was cut while somebody was owed."""
    turns = len(played.play.actions or ())
    places = [turn for turn in range(1, turns + 1) if turn < len(paid) and paid[turn]]
    if not places:
        return
    turn = places[-1]
    lab.play(_cut(played.play, turn), env, state=False)
    reset = lab.call("reset", env.reset, seed=played.play.seed)
    lab.meter.count()
    if reset.failed is None:
        books = {
            "last": _last(lab, env) or 0.0,
            "rewards": _book(lab, env, "rewards"),
            "cumulative": _book(lab, env, "_cumulative_rewards"),
        }
        yield lab.fact("owed", books, turn=turn, field="received")


def _cut(play: Play, turns: int) -> Play:
    return replace(play, actions=(play.actions or ())[:turns], most_turns=max(turns, 1))


def _last(lab: Lab, env: Any) -> float | None:
    """The reward of `last()`, where somebody is in turn and it is a number."""
    if not lab.call("agents", getattr, env, "agents").value:
        return None
    called = lab.call("last", env.last, False)
    if called.failed is not None and called.failed.kind == "TypeError":
        called = lab.call("last", env.last)  # one of its own, that always observes
    try:
        reward = called.value[1]
    except (TypeError, IndexError):
        return None
    return float(reward) if _is_real(reward) else None


def _book(lab: Lab, env: Any, name: str) -> dict[Any, float]:
    """What isn't 0 in a book, by agent; what is no number stands for nothing."""
    book = lab.call(name, getattr, env, name).value
    if not isinstance(book, Mapping):
        return {}
    return {agent: float(reward) for agent, reward in book.items()
            if _is_real(reward) and reward}  # fmt: skip


def _is_real(value: Any) -> bool:
    return isinstance(value, Real) and bool(np.isfinite(float(value)))


def _put(env: Any, agent: Any, value: float) -> None:
    env.rewards[agent] = value
