"""Probe of values that are overwritten by their reader."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from operator import methodcaller
from typing import Any, Final

import pyarrow as pa
from numpy.random import Generator

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.compared_reproducer import (
    OVERWRITE,
    OVERWRITE_MASKS,
    env_steps_of,
    first_divergence_words,
    story_proof,
)
from gamekeeper.checks.facts.handed_facts import WrittenValues
from gamekeeper.checks.probe_evidence import Fact
from gamekeeper.episodes.divergence import Divergence
from gamekeeper.episodes.episode import MASK, Episode
from gamekeeper.interface.capture import AgentId
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult
from gamekeeper.rollouts.intervention import Hooks, Intervention
from gamekeeper.rollouts.snapshots import Undo, overwrite

SURE: Final = 3
"""More unchanged reruns of an episode that diverges: with few draws, two are often equal."""
KINDS: Final = ("observations", "infos", "masks", "dictionaries", "state")


@probe("written", share=0.8, plays=lambda session: session.long_plays(4, runs=3, most_turns=200))
def written(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Returned values, overwritten: does the episode change?

    Plays the same actions while everything that was handed out is overwritten after each turn.

    Where the episode goes another way, each kind of thing is overwritten alone to tell which it
    was.

    Facts:
        `WrittenValues`.
    """
    base = session.play(play, state=False)
    if base.failed is not None:  # what it does then is for others to look at
        return
    asked = next((kinds for kinds in (KINDS, KINDS[:-1]) if _bears(session, base, kinds)), None)
    if asked is None:  # it differs by itself, or by being asked
        return
    pen = _Pen(session, asked, writes=True)
    everything = _played(session, base, pen)
    kinds = [kind for kind in asked if pen.count.get(kind)]
    if _first_divergence(session, "", base, everything) is None:
        for kind in kinds:
            yield session.fact(WrittenValues(seen=None), field=kind)
        return
    if all(_bears(session, base, asked) for _ in range(SURE)):  # else it does so now and then
        for kind in kinds:
            yield _alone(session, kind, base)


def _bears(session: ProbeSession, base: EpisodeResult, kinds: tuple[str, ...]) -> bool:
    """True if the episode is the same with values read and not written: the unchanged rerun."""
    unchanged_rerun = _played(session, base, _Pen(session, kinds, writes=False))
    return _first_divergence(session, "", base, unchanged_rerun) is None


def _played(session: ProbeSession, base: EpisodeResult, pen: _Pen) -> EpisodeResult:
    try:
        if session.api == "parallel":
            return session.play(base.play, watch=pen, state=False)
        return session.play(base.play, change=HandoutsOverwritten(pen), state=False)
    finally:
        pen.undo.undo()  # an array of a module outlives its instance, and would spoil later plays


def _alone(session: ProbeSession, kind: str, base: EpisodeResult) -> Fact[WrittenValues]:
    """Effect of overwriting one kind of value."""
    pen = _Pen(session, (kind,), writes=True)
    played = _played(session, base, pen)
    found = _first_divergence(session, kind, base, played)
    if found is None:
        return session.fact(WrittenValues(seen=None), field=kind)
    seen = first_divergence_words(found)
    if played.failed is not None:
        seen = f"{played.failed.call} raises {played.failed.said}"
    turn, proof = env_steps_of(found), _proof(session.api, kind)
    return session.fact(WrittenValues(seen), turn=turn, field=kind, proof=proof)


def _first_divergence(
    session: ProbeSession, kind: str, base: EpisodeResult, other: EpisodeResult
) -> Divergence | None:
    """First divergence of the other episode from its base.

    Infos of an AEC environment are its own dictionaries, which stay what they are until its rules
    replace them: what is written into them is read there again, and that is no fault by itself.
    """
    one, two = base.episode, other.episode
    if session.api == "aec" and kind in ("", "infos", "masks"):
        one, two = _without_infos(one), _without_infos(two)
    return session.divergence(one, two)


def _without_infos(episode: Episode) -> Episode:
    steps = episode.steps
    for name in ("info", "action_mask"):
        place = steps.schema.get_field_index(name)
        nulls = pa.nulls(steps.num_rows, steps.schema.field(place).type)
        steps = steps.set_column(place, steps.schema.field(place), nulls)
    return replace(episode, steps=steps, _cache={})


@dataclass(slots=True)
class _Pen:
    """Writes into what was handed out, or only asks for it where it doesn't write."""

    session: ProbeSession
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
                value = self.session.call("state", methodcaller("state"), env).value
            elif kind == "dictionaries":
                value = parts if self.session.api == "parallel" else []
            else:
                value = _of_kind(kind, parts)
            if self.writes:
                written = _empty(value) if kind == "dictionaries" else overwrite(value, self.undo)
                self.count[kind] = self.count.get(kind, 0) + written


@dataclass(frozen=True, slots=True)
class HandoutsOverwritten(Intervention):
    """In an AEC environment, writes into what `last()` gives, just before each step."""

    pen: _Pen

    def start(self, rng: Generator) -> Hooks:
        """The hooks; they draw nothing."""
        return _BeforeSteps(self.pen)

    def to_json(self) -> dict[str, Any]:
        """Names the kind and what is written into."""
        return {"change": type(self).__name__, "kinds": list(self.pen.kinds)}


class _BeforeSteps(Hooks):
    def __init__(self, pen: _Pen) -> None:
        self._pen, self._env = pen, None

    def between(self, turn: int, env: Any) -> None:
        """Remembers the environment."""
        self._env = env

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """Looks once more, and writes into that: no look comes between it and the step."""
        last = self._pen.session.call("last", self._env.last).value  # type: ignore[attr-defined]
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


def _proof(api: str, kind: str) -> Reproducer:
    if kind == "dictionaries":
        return story_proof(api, "for part in out:\n    part.clear()")
    if kind == "state":
        first = OVERWRITE + "\n"
        return story_proof(api, "overwrite(env.state())", idle="env.state()", first=first)
    out = "out" if api == "parallel" else "env.last()"
    lines = f"overwrite({out}[0])" if kind == "observations" else f"overwrite({out}[-1])"
    first = OVERWRITE
    if kind == "masks":
        # asked for once: a look after the writing may fix it
        lines = f"given = {out}\nfor part in (given[0], given[-1]):\n    overwrite_masks(part)"
        first = OVERWRITE_MASKS
    idle = "pass" if api == "parallel" else out
    return story_proof(api, lines, idle=idle, first=first + "\n", infos=kind == "observations")
