"""What was handed out is written into: does the game go another way?"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Final

import pyarrow as pa

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.audit.story import OVERWRITE, crossings_of, parting_words, story_proof
from gamekeeper.core.divergence import Divergence, compare
from gamekeeper.core.fact import Fact
from gamekeeper.core.proof import Proof
from gamekeeper.core.trace import Trace
from gamekeeper.run.episode import Play, Played
from gamekeeper.run.handed import overwrite

SHARE: Final = 0.8
KINDS: Final = ("observations", "infos", "dictionaries", "state")


def plays(lab: Lab) -> Iterator[Play]:
    """Two plays; each is played as it is, with a sham, and written into."""
    return lab.plays(2, runs=3, most_turns=200)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Plays the same actions while everything that was handed out is overwritten after each turn.

    Where the play goes another way, each kind of thing is overwritten alone to tell which it was.

    Facts:
        `written`: of one kind (the field: `observations`, `infos`, `state`, `dictionaries`: those
            that a Parallel environment's step returns): how many `writes` there were, and `seen`:
            None, or in words how the play went another way at the fact's turn.
    """
    base = lab.play(play, state=False)
    asked = next((kinds for kinds in (KINDS, KINDS[:-1]) if _bears(lab, base, kinds)), None)
    if asked is None:  # it differs by itself, or by being asked
        return
    pen = _Pen(lab, asked, writes=True)
    everything = lab.play(base.play, watch=pen, state=False)
    kinds = [kind for kind in asked if pen.count.get(kind)]
    if _parting(lab, "", base, everything) is None:
        for kind in kinds:
            yield lab.fact("written", {"writes": pen.count[kind], "seen": None}, field=kind)
        return
    for kind in kinds:
        yield _alone(lab, kind, base)


def _bears(lab: Lab, base: Played, kinds: tuple[str, ...]) -> bool:
    """Whether the play is the same where things are asked for and not written into: the sham."""
    sham = lab.play(base.play, watch=_Pen(lab, kinds, writes=False), state=False)
    return _parting(lab, "", base, sham) is None


def _alone(lab: Lab, kind: str, base: Played) -> Fact:
    """What overwriting one kind of thing comes to."""
    pen = _Pen(lab, (kind,), writes=True)
    played = lab.play(base.play, watch=pen, state=False)
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
    if lab.api == "aec" and kind in ("", "infos"):
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
    """A watch that writes into what was handed out, or only asks for it where it doesn't write."""

    lab: Lab
    kinds: tuple[str, ...]
    writes: bool
    count: dict[str, int] = field(default_factory=dict)

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """Writes."""
        for kind in self.kinds:
            value = self._handed(kind, env, out)
            write: Callable[[Any], int] = _empty if kind == "dictionaries" else overwrite
            if self.writes:
                self.count[kind] = self.count.get(kind, 0) + write(value)

    def _handed(self, kind: str, env: Any, out: Any) -> Any:
        if kind == "state":
            return self.lab.call("state", getattr(env, "state", None)).value if env.agents else None
        if self.lab.api == "parallel":
            parts = list(out) if isinstance(out, tuple | list) else []
            if kind == "dictionaries":
                return parts
            return parts[0 if kind == "observations" else -1] if parts else None
        if kind == "dictionaries" or not env.agents:
            return None
        last = self.lab.call("last", env.last).value
        return last[0 if kind == "observations" else -1] if isinstance(last, tuple) else None


def _empty(parts: Any) -> int:
    """Empties dictionaries, as a wrapper does that takes out who is gone."""
    for part in parts or ():
        if isinstance(part, dict):
            part.clear()
    return len(parts or ())


def _proof(api: str, kind: str) -> Proof:
    if kind == "dictionaries":
        return story_proof(api, "for part in out:\n    part.clear()")
    place = "0" if kind == "observations" else "-1"
    handed = "env.state()" if kind == "state" else f"env.last()[{place}]"
    if kind != "state" and api == "parallel":
        handed = f"out[{place}]"
    idle = "pass" if handed.startswith("out") else handed
    return story_proof(
        api, f"overwrite({handed})", idle=idle, first=OVERWRITE + "\n", infos=kind != "infos"
    )
