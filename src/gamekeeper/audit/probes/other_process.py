"""A play in this process and in another, under another hash seed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.elsewhere import other_hash_seed, played_elsewhere, reason_against
from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.divergence import Divergence, compare
from gamekeeper.core.gathered import Twin
from gamekeeper.core.trace import Trace
from gamekeeper.run.episode import Play
from gamekeeper.run.global_generators import held

SHARE: Final = 0.5
TRIES: Final = 2
"""Every look starts a process, which takes about a second."""
MOST_TURNS: Final = 100
SECOND_FROM: Final = 150
"""Ration in steps from which on a second hash seed is tried."""


def against(lab: Lab) -> str | None:
    """Only what is named by text can be opened elsewhere."""
    return reason_against(lab)


def plays(lab: Lab) -> Iterator[Play]:
    """One, or two under different hash seeds."""
    count = 2 if lab.ration >= SECOND_FROM else 1
    return lab.plays(count, runs=2, most_turns=MOST_TURNS)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The play here and its twin there.

    Facts:
        `hash seed`: that of the other process, beside a twin that parts.
        `settled in new processes`: beside a sham that parts: whether two new processes with one
            hash seed agree, so that what parts here was left behind by instances before.
    """
    with held():
        base = lab.play(play, lab.env())
    seed = other_hash_seed(sorted(lab.agents), 1 + 100 * lab.number)
    there = played_elsewhere(lab, base, seed)
    if there is None:
        return
    change = {"change": "another process", "hash_seed": seed}
    sham = base.trace
    if _parts(lab, base.trace, there) is not None:
        with held():
            sham = lab.play(base.play, lab.env()).trace
        yield lab.fact("hash seed", seed)
        if _parts(lab, base.trace, sham) is not None:
            once_more = played_elsewhere(lab, base, seed)
            is_settled = once_more is not None and _parts(lab, there, once_more) is None
            yield lab.fact("settled in new processes", is_settled)
    yield Twin(base.trace, sham, there, change, tuple(lab.contract.volatile_infos()))


def _parts(lab: Lab, one: Trace, two: Trace) -> Divergence | None:
    return compare(one, two, volatile=lab.contract.volatile_infos()).divergence
