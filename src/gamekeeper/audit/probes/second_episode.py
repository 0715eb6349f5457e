"""An episode in an instance that was used before, beside the same in a fresh one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.divergence import compare
from gamekeeper.core.gathered import Twin
from gamekeeper.core.trace import Trace
from gamekeeper.run.episode import Actions, Play, Played
from gamekeeper.run.global_generators import held

SHARE: Final = 1.5
APART: Final = 1000
"""How far the seed of the episode before is from that of the play."""


def plays(lab: Lab) -> Iterator[Play]:
    """Long ones, so that whole episodes go before."""
    return lab.plays(2, runs=6)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Twins: what went before the play differs.

    The same episode, one of another seed that is cut in its middle, a reset with the same seed and
    no step. Each comes only where those before it told nothing. Facts, beside a twin that parts:
        `before`: the seed and the actions of the episode that went before; None: the same one.
        `later seeds`: whether seeds make a difference [in a fresh instance, in a used one].
    """
    volatile = tuple(lab.contract.volatile_infos())
    with held():
        base = lab.play(play, lab.env())
    change = {"change": "an episode before"}
    for before in (base.play, _cut(lab, base), replace(base.play, actions=(), most_turns=0)):
        after = _after(lab, before, base.play)
        if compare(base.trace, after.trace, volatile=volatile).divergence is None:
            yield Twin(base.trace, base.trace, after.trace, change, volatile)
            continue
        with held():
            sham = lab.play(base.play, lab.env())
        yield Twin(base.trace, sham.trace, after.trace, change, volatile)
        if compare(base.trace, sham.trace, volatile=volatile).divergence is None:
            yield lab.fact("before", None if before is base.play else _on_paper(lab, before))
            yield lab.fact("later seeds", _seeds_matter(lab, before, base, after))
        return


def _cut(lab: Lab, base: Played) -> Play:
    # an odd number of turns in one look, an even one in the other: somebody else may be in turn
    turns = len(base.play.actions or ()) // 4 * 2 + 1 + lab.number % 2
    seed = (base.play.seed or 0) + APART
    return Play(seed=seed, stream=base.play.stream + APART, most_turns=turns)


def _after(lab: Lab, before: Play, play: Play) -> Played:
    """The play in an instance in which another was played before."""
    with held():
        env = lab.env()
        lab.play(before, env)
    with held():
        return lab.play(play, env)


def _on_paper(lab: Lab, before: Play) -> tuple[int | None, tuple[Actions, ...]]:
    if before.actions is None:
        with held():
            before = lab.play(before, lab.env()).play
    return before.seed, before.actions or ()


def _seeds_matter(lab: Lab, before: Play, base: Played, after: Played) -> tuple[bool, bool]:
    """Whether another seed makes another play, in a fresh instance and in a used one."""
    other = replace(base.play, seed=(base.play.seed or 0) + 1)
    with held():
        fresh = lab.play(other, lab.env())
    used = _after(lab, before, other)
    return _differ(lab, base.trace, fresh.trace), _differ(lab, after.trace, used.trace)


def _differ(lab: Lab, one: Trace, two: Trace) -> bool:
    return compare(one, two, volatile=lab.contract.volatile_infos()).divergence is not None
