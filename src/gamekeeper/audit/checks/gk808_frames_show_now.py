"""GK808."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._films import filmed, nothing_to_film
from gamekeeper.core.contract import Contract
from gamekeeper.core.fact import Fact
from gamekeeper.core.gathered import Gathered

LATE = (
    "env = make()\nenv.reset(seed=SEED)\nfor action in ACTIONS:\n{step}"
    "assert np.array_equal(frames[-1], env.render()), 'an older frame is shown'"
)
AGAIN = (
    "env.reset(seed=SEED)\n"
    "assert np.array_equal(frames[0], env.render()), 'a frame of the episode before is shown'"
)


@check(
    "GK808",
    needs=("render",),
    severity=MEDIUM,
    mend="draw when render() is called, or forget what was drawn in step() and in reset()",
    applies=nothing_to_film,
)
def frames_show_now(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A frame shows the game as it stands, not an older moment that was drawn and kept.

    A frame counts as old where an instance that was never rendered before shows another at the very
    same moment, and it equals the first one of its play, or what such an instance shows a turn
    earlier, or at the turn since which the film has shown the same; or where, after a second reset,
    it equals the last one of the episode before. So trails and animations are no fault.

    Bad:
        if self.frame is None:
            self.frame = self.draw()
        return self.frame

    Good:
        return self.draw()
    """
    step = "    env.step(action)\n"
    step = step if evidence.api == "parallel" else f"    env.last()\n{step}"
    films = {_key(fact): fact.value["shots"] for fact in evidence.facts("render", "film")}
    fresh = {
        (*_key(fact), fact.value["turn"]): fact.value["digest"]
        for fact in evidence.facts("render", "late")
    }
    for fact in evidence.facts("render", "late", "again"):
        shots, digest = films.get(_key(fact), []), fact.value["digest"]
        turn = fact.value["turn"] if fact.name == "late" else 0
        shot = _shown(shots, turn)
        if shot is None or digest is None:
            continue
        if fact.name == "late":
            earlier = (fresh.get((*_key(fact), t)) for t in (turn - 1, _since(shots, turn)))
            is_old = shot in (shots[0]["digest"], *earlier)
            where, seen = replace(fact.where, turn=turn, field="late"), "an earlier frame"
        else:
            is_old = digest == shots[-1]["digest"]
            where, seen = replace(fact.where, field="again"), "the last frame of the episode before"
        is_ok = not (is_old and shot != digest)
        lines = LATE.format(step=step) if fact.name == "late" else AGAIN
        proof = filmed(evidence.api, fact.value["options"], lines)
        told = "a frame of this moment"
        yield Occasion(where, is_ok, told, told if is_ok else seen, proof=proof)


def _shown(shots: Sequence[Mapping[str, Any]], turn: int) -> str | None:
    """The digest of a film's frame at this turn."""
    return next((shot["digest"] for shot in shots if shot["turn"] == turn), None)


def _since(shots: Sequence[Mapping[str, Any]], turn: int) -> int:
    """The first of the turns in a row, this one the last, at which the film shows the same."""
    while turn and _shown(shots, turn - 1) == _shown(shots, turn):
        turn -= 1
    return turn


def _key(fact: Fact) -> tuple[int, str]:
    return fact.where.play, fact.value["mode"]
