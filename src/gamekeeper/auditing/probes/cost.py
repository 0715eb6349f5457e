"""Probes of cost: lines of Python and memory, never the clock."""

import gc
import sys
import tracemalloc
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, TypeVar

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import RESET_STEPS, Called, ProbeSession, Saw
from gamekeeper.auditing.probes.moves import affordable
from gamekeeper.checks.facts.cost_facts import EpisodeWork, TurnWork
from gamekeeper.rollouts.episode_loop import EpisodePlan

T = TypeVar("T")

PAD: Final = "*_arraypad_impl.py"


@dataclass(frozen=True, slots=True)
class Work:
    """Cost of one piece of work.

    Attributes:
        lines: of Python, as a debugger steps through them.
        passing_bytes: memory that was taken at the peak, beyond what was there before.
    """

    lines: int
    passing_bytes: int


@contextmanager
def traced_memory() -> Iterator[None]:
    """Memory is traced in here; where somebody episodes it already, they go on doing so."""
    is_traced = tracemalloc.is_tracing()
    gc.freeze()  # what is there already needn't be gone through at every collection
    if not is_traced:
        tracemalloc.start()
    try:
        yield
    finally:
        if not is_traced:
            tracemalloc.stop()
        gc.unfreeze()


def work_of(function: Callable[[], T]) -> tuple[T, Work]:
    """Result of a call, and its cost; within `traced_memory`."""
    counted = 0

    def count(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal counted
        counted += event == "line"
        return count

    before, debugger = tracemalloc.get_traced_memory()[0], sys.gettrace()
    tracemalloc.reset_peak()
    sys.settrace(count)
    try:
        value = function()
    finally:
        sys.settrace(debugger)
    return value, Work(counted, tracemalloc.get_traced_memory()[1] - before)


def kept_bytes() -> int:
    """Bytes in use of what was taken since tracing began, but for two takers that nobody can fix.

    NumPy 2.4's `pad` keeps some 50 bytes at every call, and tracing has books of its own.
    """
    others = [tracemalloc.Filter(False, name) for name in (PAD, tracemalloc.__file__)]
    return sum(each.size for each in tracemalloc.take_snapshot().filter_traces(others).traces)


LEAST_TURNS: Final = 60
MOST_TURNS: Final = 120
MOST_BYTES: Final = 192 << 20
"""Bytes of observations in the episode that is kept."""
TWO_PLAYS: Final = 600
"""With so many steps a second episode confirms the first."""


def _long_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """One or two, as long as the ration allows."""
    count = 2 if session.ration >= TWO_PLAYS else 1
    turns = min(max(session.ration // (2 * count), LEAST_TURNS), MOST_TURNS)
    turns = affordable(session, turns, MOST_BYTES)
    return session.plays_of([turns] * count)


@probe("long", share=1.5, plays=_long_plays)
def long(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """A long episode, with the lines of Python and the memory that each turn takes.

    The work of each turn of an episode, that was played once before for its actions.

    A scripted play shows nothing: it would be a shorter one, and length is what this is about.

    Facts:
        `TurnWork`.
    """
    if play.actions is not None:
        return
    played = session.play(play, state=False)
    env = session.env()
    session.meter.count(RESET_STEPS)
    if session.call("reset", env.reset, seed=play.seed, options=play.options).failed is not None:
        return
    turns: list[tuple[int, int, int, int]] = []
    with traced_memory():
        for actions in played.play.actions or ():
            live = len(env.agents)
            if not live:
                break
            session.meter.count()
            given = session.handed(actions)
            gc.collect()  # what only waits for the collector isn't kept
            size = tracemalloc.get_traced_memory()[0]
            called, work = work_of(lambda given=given: _turn(session, env, given))  # type: ignore[misc]  # bound in this turn
            if called.failed is not None:
                break
            turns.append((live, work.lines, work.passing_bytes, size))
            del called
    yield session.fact(
        TurnWork(*(zip(*turns, strict=True) if turns else ((), (), (), ()))), field="step"
    )


def _turn(session: ProbeSession, env: Any, given: Any) -> Called:
    """A step; what it shows is worked out by it, or in an AEC environment by `last()`."""
    if session.api == "aec":
        session.call("last", env.last)
    return session.call("step", env.step, given)


TURNS: Final = 10
EPISODES: Final = 12


@probe("repeated", share=0.8, plays=lambda session: session.plays_of([TURNS]))
def repeated(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """One short episode repeated in one instance: its cost each time, and the memory it leaves.

    The same short episode over and over.

    Facts:
        `EpisodeWork`.
    """
    env = session.env()
    script = session.play(play, env, state=False).play.actions or ()
    if not script:
        return
    lines, passing, sizes = (array("q", [0] * EPISODES) for _ in range(3))  # take no more memory
    with traced_memory():
        for k in range(EPISODES):
            session.meter.count(
                RESET_STEPS + len(script)
            )  # outside: signs of life take lines of their own
            done, work = work_of(lambda: _episode(session, env, play, script))
            if not done:
                return
            gc.collect()
            lines[k], passing[k] = work.lines, work.passing_bytes
            sizes[k] = kept_bytes()
    value = EpisodeWork(lines=list(lines), passing=list(passing), sizes=list(sizes))
    yield session.fact(value, field="episodes")


def _episode(session: ProbeSession, env: Any, play: EpisodePlan, script: tuple[Any, ...]) -> bool:
    """Tells whether the episode could be played."""
    if session.call("reset", env.reset, seed=play.seed, options=play.options).failed is not None:
        return False
    for actions in script:
        if not env.agents:
            break
        if session.api == "aec":
            session.call("last", env.last)
        given = actions if session.api == "parallel" else next(iter(actions.values()), None)
        if session.call("step", env.step, given).failed is not None:
            return False
    return True
