"""Seeds that are easily taken for something else: 0 for none, large ones for no integer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.divergence import compare
from gamekeeper.core.gathered import Twin
from gamekeeper.run.episode import Play, Played
from gamekeeper.run.global_generators import held

SHARE: Final = 1.0
SEEDS: Final = (0, 2**31 - 1)
PLAIN: Final = 12345
"""A seed like any other, to compare with."""
MOST_TURNS: Final = 8
AGAIN: Final = 4
"""Further plays of a seed: where few openings are possible, two are often equal by chance."""


def plays(lab: Lab) -> Iterator[Play]:
    """One for each of the seeds."""
    for seed, play in zip(
        SEEDS, lab.plays(len(SEEDS), runs=AGAIN + 1, most_turns=MOST_TURNS), strict=True
    ):
        yield replace(play, seed=seed)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The play and its twin.

    Facts:
        `refused`: what the reset raised.
        `plain`: beside a twin that parts and a reset that raises: whether all goes well with a
            plain seed.
    """
    volatile = tuple(lab.contract.volatile_infos())
    one, two = _twice(lab, play)
    yield Twin(one.trace, one.trace, two.trace, {"change": "nothing", "seed": play.seed}, volatile)
    is_refused = one.failed is not None and one.failed.call == "reset"
    if one.failed is not None and is_refused:
        yield lab.fact("refused", f"{one.failed.kind}: {one.failed.text}")
    if is_refused or _parts(lab, one, two):
        plain, again = _twice(lab, replace(play, seed=PLAIN, actions=None))
        is_same = not _parts(lab, plain, again)
        raises = plain.failed is not None and plain.failed.call == "reset"
        yield lab.fact("plain", is_same and not raises)


def _twice(lab: Lab, play: Play) -> tuple[Played, Played]:
    """The play, and another one of it that differs because of its seed, where one does.

    What differs only in a used instance is the seed's doing where plays without a seed go the same
    way; else it is what the last play left.
    """
    one = _fresh(lab, play)[0]
    paper = replace(play, actions=one.play.actions)
    again, env = _fresh(lab, paper)
    used = [again]
    while len(used) < AGAIN and not _parts(lab, one, used[-1]):
        used.append(_played(lab, paper, env))
    if len(used) == 1 or not _parts(lab, one, used[-1]):
        return one, used[-1]
    if not _parts(lab, used[-1], _unseeded(lab, paper, len(used))):
        return one, used[-1]
    for _ in range(AGAIN):
        again = _fresh(lab, paper)[0]
        if _parts(lab, one, again):
            break
    return one, again


def _unseeded(lab: Lab, paper: Play, count: int) -> Played:
    """The last of so many plays in one instance, of which only the first has its seed."""
    played, env = _fresh(lab, paper)
    for _ in range(count - 1):
        played = _played(lab, replace(paper, seed=None), env)
    return played


def _fresh(lab: Lab, play: Play) -> tuple[Played, Any]:
    with held():
        env = lab.env()
    return _played(lab, play, env), env


def _played(lab: Lab, play: Play, env: Any) -> Played:
    with held():
        return lab.play(play, env)


def _parts(lab: Lab, one: Played, two: Played) -> bool:
    volatile = lab.contract.volatile_infos()
    return compare(one.trace, two.trace, volatile=volatile).divergence is not None
