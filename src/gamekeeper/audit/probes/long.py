"""A long play, and the work of each of its turns: lines of Python and memory, never the clock."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.lab import RESET_STEPS, Called, Lab, Saw
from gamekeeper.audit.probes._moves import affordable
from gamekeeper.audit.probes._work import traced_memory, work_of
from gamekeeper.run.episode import Play

SHARE: Final = 1.5
NAMES: Final = ("live", "lines", "passing", "sizes")
LEAST_TURNS: Final = 60
MOST_TURNS: Final = 120
MOST_BYTES: Final = 192 << 20
"""Of observations in the play that is kept."""
TWO_PLAYS: Final = 600
"""With so many steps a second play confirms the first."""


def plays(lab: Lab) -> Iterator[Play]:
    """One or two, as long as the ration allows."""
    count = 2 if lab.ration >= TWO_PLAYS else 1
    turns = min(max(lab.ration // (2 * count), LEAST_TURNS), MOST_TURNS)
    turns = affordable(lab, turns, MOST_BYTES)
    for k in range(count):
        yield Play(seed=lab.seed + k, stream=k, most_turns=turns)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The work of each turn of a play, that was played once before for its actions.

    A play on paper shows nothing: it would be a shorter one, and length is what this is about.

    Facts:
        `work`: a sequence by turn each: `live` (agents in the roster), `lines`, `passing` (bytes at
            the peak), `sizes` (of the memory in use before it).
    """
    if play.actions is not None:
        return
    played = lab.play(play, state=False)
    env = lab.env()
    lab.meter.count(RESET_STEPS)
    if lab.call("reset", env.reset, seed=play.seed, options=play.options).failed is not None:
        return
    turns: list[tuple[int, int, int, int]] = []
    with traced_memory():
        for actions in played.play.actions or ():
            live = len(env.agents)
            if not live:
                break
            lab.meter.count()
            given = actions if lab.api == "parallel" else next(iter(actions.values()), None)
            size = tracemalloc.get_traced_memory()[0]
            called, work = work_of(lambda given=given: _turn(lab, env, given))  # type: ignore[misc]  # bound in this turn
            if called.failed is not None:
                break
            turns.append((live, work.lines, work.passing_bytes, size))
            del called
    yield lab.fact("work", dict(zip(NAMES, zip(*turns, strict=True), strict=False)), field="step")


def _turn(lab: Lab, env: Any, given: Any) -> Called:
    """A step; what it shows is worked out by it, or in an AEC environment by `last()`."""
    if lab.api == "aec":
        lab.call("last", env.last)
    return lab.call("step", env.step, given)
