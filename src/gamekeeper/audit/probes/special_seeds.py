"""Seeds that are easily taken for something else: 0 for none, large ones for no integer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

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
    if is_refused or compare(one.trace, two.trace, volatile=volatile).divergence is not None:
        plain, again = _twice(lab, replace(play, seed=PLAIN, actions=None))
        is_same = compare(plain.trace, again.trace, volatile=volatile).divergence is None
        raises = plain.failed is not None and plain.failed.call == "reset"
        yield lab.fact("plain", is_same and not raises)


def _twice(lab: Lab, play: Play) -> tuple[Played, Played]:
    """The play, and another one of it that differs, where one does."""
    with held():
        one = lab.play(play, lab.env())
    with held():
        env = lab.env()
    for _ in range(AGAIN):
        with held():
            again = lab.play(replace(play, actions=one.play.actions), env)
        if compare(one.trace, again.trace, volatile=lab.contract.volatile_infos()).divergence:
            break
    return one, again
