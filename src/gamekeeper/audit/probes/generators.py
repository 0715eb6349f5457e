"""The generators that all of a process shares: watched in one play, disturbed in the next."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.divergence import compare
from gamekeeper.core.gathered import Twin
from gamekeeper.run.changes.global_generators import GlobalGeneratorsDisturbed
from gamekeeper.run.episode import Play
from gamekeeper.run.global_generators import held, states

SHARE: Final = 1.5
OTHER: Final = 5_180_211
"""Seed of the global generators while the second instance is built."""


def plays(lab: Lab) -> Iterator[Play]:
    """Long ones: what is drawn rarely is drawn at an end, or when two meet."""
    return lab.plays(3, runs=2)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """A twin, and what became of the global generators meanwhile.

    Facts:
        `left alone`: a generator's name; nobody moved it.
        `moved`: [name, call]; the first call that moved it, `make`, `reset` or `step`.
    """
    moved: dict[str, tuple[str, int]] = {}
    with held():
        seen = states()

        def notice(call: str, turn: int) -> None:
            now = states()
            for name in now.keys() & seen.keys():
                if now[name] != seen[name]:
                    moved.setdefault(name, (call, turn))
            seen.update(now)

        def watch(turn: int, env: Any, out: Any) -> None:
            notice("step" if turn else "reset", turn)

        env = lab.env()
        notice("make", 0)
        base = lab.play(play, env, watch=watch)
    for name in sorted(seen):
        if name in moved:
            call, turn = moved[name]
            yield lab.fact("moved", [name, call], turn=turn, field=name)
        else:
            yield lab.fact("left alone", name, field=name)
    change = GlobalGeneratorsDisturbed()
    with held(OTHER):
        disturbed = lab.play(base.play, lab.env(), change=change)
    sham, volatile = base, tuple(lab.contract.volatile_infos())
    if compare(base.trace, disturbed.trace, volatile=volatile).divergence is not None:
        with held():
            sham = lab.play(base.play, lab.env())
    yield Twin(base.trace, sham.trace, disturbed.trace, change.to_json(), volatile)
