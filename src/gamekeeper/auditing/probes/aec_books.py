"""Probe of an AEC environment's books: `last()`, `rewards`, resets."""

from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Any, Final

import numpy as np

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.probes.moves import cut
from gamekeeper.checks.facts.aec_book_facts import LastRewards, MarkedReward, OwedAfterReset
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult

PLAYS: Final = 3
RUNS: Final = 5
"""An episode itself, the one with marks, and three that a reset cuts."""
MOST_MARKS: Final = 12
"""Steps of one episode before which rewards are marked."""
MARK: Final = 1234.567
"""Added to a reward before a step, times its size and one."""
NEAR: Final = 1e-3
"""Tolerance, as a part of the mark: accounts may be of float16."""


@probe("books", share=1.5, plays=lambda session: session.plays(PLAYS, runs=RUNS), api="aec")
def books(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """`last()`, `rewards` and cumulative rewards of an AEC environment, and its resets.

    The episode; then the same episode with marked rewards, and cut by a reset: after its last
    payment, and where one agent is due most, in all and before any has ended.

    Facts:
        `LastRewards`, `MarkedReward`, `OwedAfterReset`.
    """
    env = session.env()
    told: dict[int, Any] = {}
    paid: list[dict[Any, float]] = []
    due: list[float] = []

    def watch(turn: int, env: Any, out: Any) -> None:
        reward = _last(session, env)
        if reward is not None:
            told[turn] = reward
        paid.append(_book(session, env, "rewards"))
        due.append(max(map(abs, _book(session, env, "_cumulative_rewards").values()), default=0.0))

    played = session.play(play, env, watch=watch, state=False)
    yield played.episode
    yield session.fact(LastRewards(told), field="cumulative_reward")
    if not any(paid):
        return
    yield from _marks(session, env, played, paid)
    turns = min(len(played.play.actions or ()) + 1, len(due))
    last = [turn for turn in range(1, turns) if paid[turn]][-1:]
    end = next((turn.index for turn in played.episode.turns if turn.ended), turns)
    most = [sorted(range(1, k), key=lambda turn: due[turn])[-1:] for k in (turns, min(turns, end))]
    for turn in dict.fromkeys(sum(most, last) if last else ()):
        yield from _owed(session, env, played, turn)


def _marks(
    session: ProbeSession, env: Any, played: EpisodeResult, paid: list[dict[Any, float]]
) -> Iterator[Saw]:
    """Tells whether values in `rewards` before a step are gone after it.

    Told by the difference from the episode without marks, so that no reward is taken for a mark.
    """
    live = [
        turn.index
        for turn in played.episode.turns
        if turn.order and turn.order[0] not in turn.ended and not turn.raised
    ]
    places = [turn for turn in live if turn < len(paid) and paid[turn]][:MOST_MARKS]
    marked: dict[int, dict[Any, float]] = {}
    after: dict[int, dict[Any, float]] = {}

    def watch(turn: int, env: Any, out: Any) -> None:
        if turn - 1 in marked:
            after[turn - 1] = _book(session, env, "rewards")
        if turn in places:
            for agent, reward in paid[turn].items():
                mark = reward + MARK * (1.0 + abs(reward))
                session.call("rewards", _put, env, agent, mark)
            now = _book(session, env, "rewards")
            raised = {agent: now.get(agent, 0.0) - reward for agent, reward in paid[turn].items()}
            marked[turn] = {agent: mark for agent, mark in raised.items() if mark > MARK / 2}

    if not places:
        return
    session.play(cut(played.play, places[-1] + 1), env, watch=watch, state=False)
    for turn in sorted(after.keys() & marked.keys()):
        for agent, mark in marked[turn].items():
            plain = paid[turn + 1] if turn + 1 < len(paid) else {}
            more = after[turn].get(agent, 0.0) - plain.get(agent, 0.0)
            stood = abs(more - mark) < NEAR * mark
            value = MarkedReward(agent=agent, reward=paid[turn][agent], mark=mark, stood=stood)
            yield session.fact(value, turn=turn, agent=agent, field="rewards")


def _owed(session: ProbeSession, env: Any, played: EpisodeResult, turn: int) -> Iterator[Saw]:
    """Cumulative rewards after a reset, where the episode before was cut with some due."""
    session.play(cut(played.play, turn), env, state=False)
    reset = session.call("reset", env.reset, seed=played.play.seed)
    session.meter.count()
    if reset.failed is None:
        books = OwedAfterReset(
            last=_last(session, env) or 0.0,
            rewards=_book(session, env, "rewards"),
            cumulative=_book(session, env, "_cumulative_rewards"),
        )
        yield session.fact(books, turn=turn, field="cumulative_reward")


def _last(session: ProbeSession, env: Any) -> float | None:
    """The reward of `last()`, where somebody is in turn and it is a number."""
    if not session.call("agents", getattr, env, "agents").value:
        return None
    called = session.call("last", env.last, False)
    if called.failed is not None and called.failed.kind == "TypeError":
        called = session.call("last", env.last)  # one of its own, that always observes
    try:
        reward = called.value[1]
    except (TypeError, IndexError):
        return None
    return float(reward) if _is_real(reward) else None


def _book(session: ProbeSession, env: Any, name: str) -> dict[Any, float]:
    """Values other than 0 in a dictionary of rewards, by agent; no number counts as 0."""
    book = session.call(name, getattr, env, name).value
    if not isinstance(book, Mapping):
        return {}
    return {agent: float(reward) for agent, reward in book.items() if _is_real(reward) and reward}


def _is_real(value: Any) -> bool:
    return isinstance(value, Real) and bool(np.isfinite(float(value)))


def _put(env: Any, agent: Any, value: float) -> None:
    env.rewards[agent] = value
