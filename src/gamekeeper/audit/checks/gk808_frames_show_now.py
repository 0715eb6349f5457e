"""GK808."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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

    A frame counts as old where it equals an earlier one of its play although an instance that was
    never rendered before shows another at the very same moment; or, after a second reset, the last
    one of the episode before.

    Bad:
        if self.frame is None:
            self.frame = self.draw()
        return self.frame

    Good:
        return self.draw()
    """
    step = "    env.step(action)\n"
    step = step if evidence.api == "parallel" else f"    env.last()\n{step}"
    films = {_key(fact): fact for fact in evidence.facts("render", "film")}
    for fact in evidence.facts("render", "late", "again"):
        film, digest = films.get(_key(fact)), fact.value["digest"]
        shots: list[Mapping[str, Any]] = [] if film is None else film.value["shots"]
        is_late = fact.name == "late"
        turn = fact.value["turn"] if is_late else 0
        shot = next((shot for shot in shots if shot["turn"] == turn), None)
        if shot is None or shot["digest"] is None or digest is None:
            continue
        older = {each["digest"] for each in shots if each["turn"] < turn}
        is_old = shot["digest"] in older if is_late else digest == shots[-1]["digest"]
        is_old = is_old and shot["digest"] != digest
        where = replace(fact.where, turn=turn if is_late else None, field=fact.name)
        lines = LATE.format(step=step) if is_late else AGAIN
        yield Occasion(
            where, not is_old, "a frame of this moment",
            "an earlier frame of the play" if is_late else "the last frame of the episode before",
            proof=filmed(evidence.api, fact.value["options"], lines),
        )  # fmt: skip


def _key(fact: Fact) -> tuple[int, str]:
    return fact.where.play, fact.value["mode"]
