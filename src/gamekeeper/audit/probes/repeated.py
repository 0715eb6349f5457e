"""One short play, again and again in one instance: what it costs each time, and what stays."""

from __future__ import annotations

import gc
from array import array
from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.lab import RESET_STEPS, Lab, Saw
from gamekeeper.audit.probes._work import kept_bytes, traced_memory, work_of
from gamekeeper.run.episode import Play

SHARE: Final = 0.8
TURNS: Final = 5
EPISODES: Final = 12


def plays(lab: Lab) -> Iterator[Play]:
    """One short play."""
    yield Play(seed=lab.seed, most_turns=TURNS)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The same short play over and over.

    Facts:
        `episodes`: `lines` and `passing` (bytes at the peak) of each episode, its reset included;
            `sizes`: memory in use after each, in bytes.
    """
    env = lab.env()
    paper = lab.play(play, env, state=False).play.actions or ()
    if not paper:
        return
    lines, passing, sizes = (array("q", [0] * EPISODES) for _ in range(3))  # take no more memory
    with traced_memory():
        for k in range(EPISODES):
            lab.meter.count(
                RESET_STEPS + len(paper)
            )  # outside: signs of life take lines of their own
            done, work = work_of(lambda: _episode(lab, env, play, paper))
            if not done:
                return
            gc.collect()
            lines[k], passing[k] = work.lines, work.passing_bytes
            sizes[k] = kept_bytes()
    value = {"lines": list(lines), "passing": list(passing), "sizes": list(sizes)}
    yield lab.fact("episodes", value, field="episodes")


def _episode(lab: Lab, env: Any, play: Play, paper: tuple[Any, ...]) -> bool:
    """Whether it could be played."""
    if lab.call("reset", env.reset, seed=play.seed, options=play.options).failed is not None:
        return False
    for actions in paper:
        if not env.agents:
            break
        if lab.api == "aec":
            lab.call("last", env.last)
        given = actions if lab.api == "parallel" else next(iter(actions.values()), None)
        if lab.call("step", env.step, given).failed is not None:
            return False
    return True
