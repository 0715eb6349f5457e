"""A play beside another instance that is built, reset and stepped in turns with it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.divergence import compare
from gamekeeper.core.gathered import Twin
from gamekeeper.run.episode import Actions, Play
from gamekeeper.run.global_generators import held

SHARE: Final = 1.0
FRESH: Final = True
APART: Final = 500
"""How far the other instance's seed is from that of the play."""


def plays(lab: Lab) -> Iterator[Play]:
    """Two, each played alone and beside another."""
    return lab.plays(2, runs=4)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The play alone, and beside the other instance.

    Facts:
        `other`: seed and actions of the other instance, beside a twin that parts.
    """
    volatile = tuple(lab.contract.volatile_infos())
    with held():
        base = lab.play(play, lab.env())
    seed = (base.play.seed or 0) + APART
    turns = max(len(base.play.actions or ()), 1)
    with held():
        other = lab.play(Play(seed, base.play.stream + APART, most_turns=turns), lab.env())
    course = other.play.actions or ()
    with held():
        env = lab.env()
        with held():
            beside = lab.env()
        twin = lab.play(base.play, env, watch=_Beside(lab, beside, seed, course))
    sham = base
    if compare(base.trace, twin.trace, volatile=volatile).divergence is not None:
        with held():
            sham = lab.play(base.play, lab.env())
        yield lab.fact("other", (seed, course))
    change = {"change": "another instance beside"}
    yield Twin(base.trace, sham.trace, twin.trace, change, volatile)


class _Beside:
    """Resets the other instance right after the first one's reset, and steps it at every turn."""

    def __init__(self, lab: Lab, env: Any, seed: int, course: tuple[Actions, ...]) -> None:
        self._lab, self._env, self._seed, self._course = lab, env, seed, course

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """What the other one raises is nobody's business here, nor what it draws globally."""
        with held():
            if turn == 0:
                self._lab.call("reset", self._env.reset, seed=self._seed)
            elif turn <= len(self._course):
                self._step(self._course[turn - 1])

    def _step(self, actions: Actions) -> None:
        if self._lab.api == "aec":
            self._lab.call("last", self._env.last)
            self._lab.step(self._env, next(iter(actions.values()), None))
        else:
            self._lab.step(self._env, dict(actions))
