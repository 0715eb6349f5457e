"""What was handed out is written into: does the game go another way?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from operator import methodcaller
from typing import Any, Final

import pyarrow as pa
from numpy.random import Generator

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.audit.story import (
    OVERWRITE,
    OVERWRITE_MASKS,
    crossings_of,
    parting_words,
    story_proof,
)
from gamekeeper.core.divergence import Divergence, compare
from gamekeeper.core.fact import Fact
from gamekeeper.core.proof import Proof
from gamekeeper.core.trace import MASK, Trace
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Change, Hooks
from gamekeeper.run.episode import Play, Played
from gamekeeper.run.handed import Undo, overwrite

SHARE: Final = 0.8
SURE: Final = 3
"""Further shams of a play that parts: where few things are drawn, two are often equal by chance."""
KINDS: Final = ("observations", "infos", "masks", "dictionaries", "state")


def plays(lab: Lab) -> Iterator[Play]:
    """Long ones; each is played as it is, with a sham, and written into."""
    return lab.long_plays(4, runs=3, most_turns=200)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Plays the same actions while everything that was handed out is overwritten after each turn.

    Where the play goes another way, each kind of thing is overwritten alone to tell which it was.

    Facts:
        `written`: of one kind (the field: `observations`, `infos`, `masks`, `state`,
            `dictionaries`: those that a Parallel environment's step returns): how many `writes`
            there were, and `seen`: None, or in words how the play went another way at the fact's
            turn.
    """
    base = lab.play(play, state=False)
    if base.failed is not None:  # what it does then is for others to look at
        return
    asked = next((kinds for kinds in (KINDS, KINDS[:-1]) if _bears(lab, base, kinds)), None)
    if asked is None:  # it differs by itself, or by being asked
        return
    pen = _Pen(lab, asked, writes=True)
    everything = _played(lab, base, pen)
    kinds = [kind for kind in asked if pen.count.get(kind)]
    if _parting(lab, "", base, everything) is None:
        for kind in kinds:
            yield lab.fact("written", {"writes": pen.count[kind], "seen": None}, field=kind)
        return
    if not all(_bears(lab, base, asked) for _ in range(SURE)):  # it differs by itself, now and then
        return
    for kind in kinds:
        yield _alone(lab, kind, base)


def _bears(lab: Lab, base: Played, kinds: tuple[str, ...]) -> bool:
    """Whether the play is the same where things are asked for and not written into: the sham."""
    sham = _played(lab, base, _Pen(lab, kinds, writes=False))
    return _parting(lab, "", base, sham) is None


def _played(lab: Lab, base: Played, pen: _Pen) -> Played:
    try:
        if lab.api == "parallel":
            return lab.play(base.play, watch=pen, state=False)
        return lab.play(base.play, change=HandoutsOverwritten(pen), state=False)
    finally:
        pen.undo.undo()  # an array of a module outlives its instance, and would spoil later plays


def _alone(lab: Lab, kind: str, base: Played) -> Fact:
    """What overwriting one kind of thing comes to."""
    pen = _Pen(lab, (kind,), writes=True)
    played = _played(lab, base, pen)
    found = _parting(lab, kind, base, played)
    if found is None:
        return lab.fact("written", {"writes": pen.count.get(kind, 0), "seen": None}, field=kind)
    seen = parting_words(found)
    if played.failed is not None:
        seen = f"{played.failed.call} raises {played.failed.kind}: {played.failed.text}"
    value = {"writes": pen.count.get(kind, 0), "seen": seen}
    return lab.fact(
        "written", value, turn=crossings_of(found), field=kind, proof=_proof(lab.api, kind)
    )


def _parting(lab: Lab, kind: str, base: Played, other: Played) -> Divergence | None:
    """Where the other play parts from its base.

    Infos of an AEC environment are its own dictionaries, which stay what they are until its rules
    replace them: what is written into them is read there again, and that is no fault by itself.
    """
    one, two = base.trace, other.trace
    if lab.api == "aec" and kind in ("", "infos", "masks"):
        one, two = _without_infos(one), _without_infos(two)
    return compare(one, two, volatile=lab.contract.volatile_infos()).divergence


def _without_infos(trace: Trace) -> Trace:
    steps = trace.steps
    for name in ("info", "mask"):
        place = steps.schema.get_field_index(name)
        nulls = pa.nulls(steps.num_rows, steps.schema.field(place).type)
        steps = steps.set_column(place, steps.schema.field(place), nulls)
    return replace(trace, steps=steps, _cache={})


@dataclass(slots=True)
class _Pen:
    """Writes into what was handed out, or only asks for it where it doesn't write."""

    lab: Lab
    kinds: tuple[str, ...]
    writes: bool
    count: dict[str, int] = field(default_factory=dict)
    undo: Undo = field(default_factory=Undo)

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """After reset and step of a Parallel environment: into what they returned."""
        self.write(env, list(out) if isinstance(out, tuple | list) else [])

    def write(self, env: Any, parts: list[Any]) -> None:
        """Writes into `parts`, of which the first are observations and the last infos."""
        for kind in self.kinds:
            if kind == "state":
                value = self.lab.call("state", methodcaller("state"), env).value
            elif kind == "dictionaries":
                value = parts if self.lab.api == "parallel" else []
            else:
                value = _of_kind(kind, parts)
            if self.writes:
                written = _empty(value) if kind == "dictionaries" else overwrite(value, self.undo)
                self.count[kind] = self.count.get(kind, 0) + written


@dataclass(frozen=True, slots=True)
class HandoutsOverwritten(Change):
    """In an AEC environment, writes into what `last()` gives, just before each step."""

    pen: _Pen

    def start(self, rng: Generator) -> Hooks:
        """The hooks; they draw nothing."""
        return _BeforeSteps(self.pen)

    def to_json(self) -> dict[str, Any]:
        """Its kind and what it writes into."""
        return {"change": type(self).__name__, "kinds": list(self.pen.kinds)}


class _BeforeSteps(Hooks):
    def __init__(self, pen: _Pen) -> None:
        self._pen, self._env = pen, None

    def between(self, turn: int, env: Any) -> None:
        """Remembers the environment."""
        self._env = env

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """Looks once more, and writes into that: no look comes between it and the step."""
        last = self._pen.lab.call("last", self._env.last).value  # type: ignore[attr-defined]
        self._pen.write(self._env, list(last) if isinstance(last, tuple) else [])
        return actions


def _of_kind(kind: str, parts: list[Any]) -> Any:
    if not parts:
        return None
    if kind == "masks":
        return [*_masks(parts[0]), *_masks(parts[-1])]
    return _unmasked(parts[0 if kind == "observations" else -1])


def _masks(value: Any) -> Iterator[Any]:
    """The action masks in a value, however deep they stand."""
    if isinstance(value, dict):
        for key, item in value.items():
            if key == MASK:
                yield item
            else:
                yield from _masks(item)


def _unmasked(value: Any) -> Any:
    """The value without its action masks."""
    if not isinstance(value, dict):
        return value
    return {key: _unmasked(item) for key, item in value.items() if key != MASK}


def _empty(parts: Any) -> int:
    """Empties dictionaries, as a wrapper does that takes out who is gone."""
    for part in parts or ():
        if isinstance(part, dict):
            part.clear()
    return len(parts or ())


def _proof(api: str, kind: str) -> Proof:
    if kind == "dictionaries":
        return story_proof(api, "for part in out:\n    part.clear()")
    if kind == "state":
        first = OVERWRITE + "\n"
        return story_proof(api, "overwrite(env.state())", idle="env.state()", first=first)
    out = "out" if api == "parallel" else "env.last()"
    lines = f"overwrite({out}[0])" if kind == "observations" else f"overwrite({out}[-1])"
    first = OVERWRITE
    if kind == "masks":
        # asked for once: a look after the writing may mend it
        lines = f"given = {out}\nfor part in (given[0], given[-1]):\n    overwrite_masks(part)"
        first += OVERWRITE_MASKS
    idle = "pass" if api == "parallel" else out
    return story_proof(api, lines, idle=idle, first=first + "\n", infos=kind == "observations")
