"""GK804."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._films import filmed, nothing_to_film
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

STAYS = (
    "env = make()\nenv.reset(seed=SEED)\nframes, copies = [], []\n"
    "for action in [None, *ACTIONS]:\n"
    "    if frames:\n{step}"
    "    frames.append(env.render())\n    copies.append(np.array(frames[-1]))\n"
    "assert all(np.array_equal(f, c) for f, c in zip(frames, copies)), 'earlier frames changed'"
)
OWN = (
    "before = np.array(frames[-1])\nframes[-1][...] = np.where(frames[-1] == 0, 1, 0)\n"
    "assert np.array_equal(env.render(), before), 'what was written shows in the next frame'"
)


@check(
    "GK804",
    needs=("render",),
    severity=MEDIUM,
    mend="return a new array from every render(): self.canvas.copy()",
    applies=nothing_to_film,
)
def frames_stay_as_they_were(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A frame is its reader's own: it doesn't change later, and writing into it shows in no other.

    Frames that are collected for a video would otherwise all show the last moment, and a caption
    that is drawn into one stays in all that follow.

    Bad:
        self.canvas[...] = 0
        ...
        return self.canvas

    Good:
        return self.canvas.copy()
    """
    step = (
        "        env.step(action)\n"
        if evidence.api == "parallel"
        else "        env.last()\n        env.step(action)\n"
    )
    for fact in evidence.facts("render", "kept"):
        seen, options = fact.value, fact.value["options"]
        proof = Proof(STAYS.format(step=step), plays=False, options=options)
        if seen["count"] > 1:
            turns = seen["turns"]
            yield Occasion(
                replace(fact.where, turn=turns[0] + 1 if turns else None, field="render"),
                not turns, "every frame as it was handed out",
                f"{len(turns)} of {seen['count']} frames changed later", proof=proof,
            )  # fmt: skip
    for fact in evidence.facts("render", "written"):
        seen, turns = fact.value, fact.value["turns"]
        if seen["count"]:
            yield Occasion(
                replace(fact.where, turn=turns[0] if turns else None, field="frame"),
                not turns, "the next frame as it would have been",
                f"what was written into {len(turns)} of {seen['count']} frames stands in the next",
                proof=filmed(evidence.api, seen["options"], OWN),
            )  # fmt: skip
