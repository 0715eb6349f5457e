"""The same seed and actions once more, in a second instance where one can be had."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.gathered import Twin
from gamekeeper.run.clock import LATER_S, later
from gamekeeper.run.episode import Play
from gamekeeper.run.global_generators import held

SHARE: Final = 1.5
PLAYS: Final = 3


def plays(lab: Lab) -> Iterator[Play]:
    """Long ones, each played twice, the first one once more."""
    return lab.plays(PLAYS, runs=2)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The play and its twin; generators of the whole process start from the same state.

    Twins by `change`: `nothing`; in the first play also `empty options`, whose sham is that, and
    `the time of day`, where nothing else made a difference.
    """
    volatile = tuple(lab.contract.volatile_infos())
    with held():
        base = lab.play(play, lab.env())
    with held():
        again = lab.play(base.play, lab.env())
    same = Twin(base.trace, base.trace, again.trace, {"change": "nothing"}, volatile)
    yield same
    if lab.number == 0 and same.divergence is None:
        for seconds in LATER_S:
            with held(), later(seconds):
                other = lab.play(base.play, lab.env())
            change = {"change": "the time of day", "later_s": seconds}
            moved = Twin(base.trace, again.trace, other.trace, change, volatile)
            yield moved
            if moved.divergence is not None:
                break
    if lab.number == 0 and play.options is None:
        short = replace(base.play, options={}, actions=(base.play.actions or ())[:1])
        with held():
            empty = lab.play(short, lab.env())
        if empty.failed is None or base.failed is not None:
            with held():
                none = lab.play(replace(short, options=None), lab.env())
            yield Twin(none.trace, none.trace, empty.trace, {"change": "empty options"}, volatile)
