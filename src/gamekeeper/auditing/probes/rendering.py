"""Probe of render modes and frames."""

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

import numpy as np

from gamekeeper.auditing.human_mode import SCREENLESS, left_out
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import Called, ProbeSession, Saw
from gamekeeper.auditing.probes.moves import affordable, cut, moves
from gamekeeper.auditing.probes.surface import modes
from gamekeeper.checks.facts.render_facts import (
    BuiltMode,
    ChangedFrames,
    FirstFrame,
    RenderedEpisode,
    SecondFrame,
    Shot,
    WrittenFrames,
)
from gamekeeper.interface.packing import type_name_of
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult

MOST_MODES: Final = 3
MOST_TURNS: Final = 40
"""Turns of a film; rendering is slow."""
WRITTEN_TURNS: Final = 6
"""Turns at which frames are written into."""
LATE_TURNS: Final = 2
"""The last turns, at which an instance is asked for its first frame."""
PATTERN: Final = 98
"""Values that are written into a frame: 1 up to here, over and over; fits into an int8."""
KEPT_BYTES: Final = 32 << 20
"""Frames that are kept to be looked at once more."""
NEEDS_MORE: Final = re.compile(
    r"display|opengl|\bglx?\b|\begl\b|x11|xcb|screen|not ?installed|ImportError|ModuleNotFound",
    re.IGNORECASE,
)
"""Words of messages about a missing screen or package, which is no fault of the env."""


@probe(
    "render",
    share=1.5,
    plays=lambda session: session.plays(2, runs=7, most_turns=affordable(session, MOST_TURNS)),
)
def render(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Every render mode but "human": an episode with frames beside one without.

    In a process without a screen it is seen if "human" raises NotImplementedError.

    A mode's instance beside the plain one, and a film beside the same without a camera.

    Counterfactuals:
        `RenderMode`, `Rendered`.

    Facts:
        `BuiltMode`, `RenderedEpisode`, `ChangedFrames`, `WrittenFrames`, `FirstFrame`,
        `SecondFrame`.
    """
    with _screenless():
        env = session.env()
        own = getattr(env, "render_mode", None)
        metadata = getattr(env, "metadata", None)
        base = session.play(play, env)
        if base.failed is not None and play.actions is not None:
            return  # a shorter play that breaks off shows another thing
        unchanged_rerun = session.play(base.play)
        takes = (
            session.can_make and session.call("make", session.make, render_mode=None).failed is None
        )
        if takes and own is not None:
            still = session.play(base.play, session.make(render_mode=None)).episode
            change = {"change": "RenderMode", "mode": None}
            yield session.beside(base.episode, unchanged_rerun.episode, still, change)
        is_asked = takes and own != "human" and _has_human(metadata) and not session.number
        human = left_out(session) if is_asked else None
        if human is not None:
            options = {"render_mode": "human"}
            yield session.fact(BuiltMode("human", True, options, human, False, None))
        in_use = [own] if isinstance(own, str) and own != "human" else []
        for mode in list(dict.fromkeys([*in_use, *modes(metadata)]))[:MOST_MODES]:
            yield from _mode(
                session, mode, own=own, takes=takes, base=base, unchanged_rerun=unchanged_rerun
            )


def _has_human(metadata: Any) -> bool:
    listed = metadata.get("render_modes") if isinstance(metadata, Mapping) else None
    return isinstance(listed, list | tuple) and "human" in listed


def _mode(
    session: ProbeSession,
    mode: str,
    *,
    own: Any,
    takes: bool,
    base: EpisodeResult,
    unchanged_rerun: EpisodeResult,
) -> Iterator[Saw]:
    is_own = mode == own
    options = {} if is_own else {"render_mode": mode}

    def built() -> Called:
        return Called(session.env()) if is_own else session.call("make", session.make, **options)

    about = BuiltMode(mode, takes or is_own, options, None, False, None)
    if not (takes or is_own):
        yield session.fact(about)
        return
    made = built()
    said = None if made.failed is None else made.failed.text.partition("\n")[0]
    shown = getattr(made.value, "render_mode", None)
    yield session.fact(replace(about, failed=said, is_missing=_is_missing(said), shown=shown))
    if made.failed is not None:
        return
    still = base
    if not is_own:
        still = session.play(base.play, made.value)
        change = {"change": "RenderMode", "mode": mode}
        yield session.beside(base.episode, unchanged_rerun.episode, still.episode, change)
        made = built()
    camera = Camera(session)
    filmed = session.play(base.play, made.value, watch=camera)
    change = {"change": "Rendered", "mode": mode}
    yield session.beside(still.episode, unchanged_rerun.episode, filmed.episode, change)
    rendered = RenderedEpisode(mode, options, moves(filmed.episode), camera.shots)
    yield session.fact(rendered, field="render")
    yield session.fact(ChangedFrames(mode, options, camera.changed(), len(camera.kept)))
    if session.divergence(base.episode, unchanged_rerun.episode) is None:
        env, again = made.value, base.play
        if session.call("reset", env.reset, seed=again.seed, options=again.options).failed is None:
            digest = _digest(session.call("render", env.render).value)
            yield session.fact(SecondFrame(mode, options, digest))
    turns = len(base.play.actions or ())
    last = range(max(turns - LATE_TURNS + 1, 1), turns + 1)
    for first in sorted({*last, *map(rendered.since, last)} - {0}):
        late = Camera(session, first=first)
        refilmed = session.play(base.play, built().value, watch=late)
        is_same = session.divergence(filmed.episode, refilmed.episode) is None
        for shot in late.shots[:1] if is_same else ():
            yield session.fact(FirstFrame(mode, options, first, shot.digest))
    pen = Pen(session)
    session.play(cut(base.play, WRITTEN_TURNS), built().value, watch=pen)
    yield session.fact(WrittenFrames(mode, options, pen.turns, pen.count))


class Camera:
    """Renders after the reset and after every step, from turn `first` on."""

    def __init__(self, session: ProbeSession, first: int = 0) -> None:
        self.shots: list[Shot] = []
        self.kept: list[tuple[int, Any, str]] = []
        self._session, self._first, self._bytes = session, first, 0

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """One frame."""
        if turn < self._first:
            return
        called = self._session.call("render", env.render)
        shot = _shot(turn, called, over=not env.agents)
        self.shots.append(shot)
        self._bytes += sum(frame.nbytes for frame in _arrays(called.value))
        if shot.digest is not None and shot.frames and self._bytes < KEPT_BYTES:
            self.kept.append((turn, called.value, shot.digest))

    def changed(self) -> list[int]:
        """Turns whose frames are no longer what they were."""
        return [turn for turn, frame, digest in self.kept if _digest(frame) != digest]


class Pen:
    """Writes into the frames of a moment, and looks whether the next frame of it shows that."""

    def __init__(self, session: ProbeSession) -> None:
        self.turns: list[int] = []
        self.count = 0
        self._session = session

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """Two frames of one moment, which agree; a third after writing into them."""
        frames = [_arrays(self._session.call("render", env.render).value) for _ in range(2)]
        before = [[array.copy() for array in each] for each in frames]
        if not before[0] or _digest(before[0]) != _digest(before[1]):
            return
        pairs = [pair for each in frames for pair in zip(each, before[0], strict=True)]
        if not all(a.flags.writeable and a.dtype.kind in "uif" and a.size for a, _ in pairs):
            return
        for array, old in pairs:  # both frames may be one array
            array[...] = _scribble(old)
        self.count += 1
        after = _arrays(self._session.call("render", env.render).value)
        if _is_shown(before[0], after):
            self.turns.append(turn)


def _is_shown(before: list[Any], after: list[Any]) -> bool:
    """Tells whether a frame differs from the last by what was written into that one."""
    differing = written = 0
    for old, new in zip(before, after, strict=False):
        if old.shape == new.shape:
            differing += int((new != old).sum())
            written += int(((new != old) & (new == _scribble(old))).sum())
    return written > 0 and written >= 0.9 * differing


def _shot(turn: int, called: Called, *, over: bool) -> Shot:
    frames = [[each.dtype.name, list(each.shape)] for each in _arrays(called.value)]
    kind, digest = type_name_of(type(called.value)), _digest(called.value)
    return Shot(turn, over, called.said, _is_missing(called.said), kind, frames, digest)


def _arrays(frame: Any) -> list[Any]:
    """The arrays that a frame consists of."""
    items = frame if isinstance(frame, list | tuple) else [frame]
    return [item for item in items if isinstance(item, np.ndarray)]


def _digest(frame: Any) -> str | None:
    """Digest of a frame's arrays or text; None where it is neither."""
    if isinstance(frame, str):
        return hashlib.blake2b(frame.encode("utf-8", "replace"), digest_size=16).hexdigest()
    arrays = _arrays(frame)
    if not arrays or any(array.dtype == object for array in arrays):
        return None
    hashed = hashlib.blake2b(digest_size=16)
    for array in arrays:
        hashed.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return hashed.hexdigest()


def _scribble(array: Any) -> Any:
    """Another value for every element, of a pattern that no picture has by itself."""
    marks = np.resize(np.arange(1, PATTERN), array.shape).astype(array.dtype)
    return np.where(array == marks, marks + 1, marks).astype(array.dtype)


def _is_missing(said: str | None) -> bool:
    return said is not None and NEEDS_MORE.search(said) is not None


@contextmanager
def _screenless() -> Iterator[None]:
    """No window opens in here; the process's surroundings are as they were afterwards."""
    before = {name: os.environ.get(name) for name in SCREENLESS}
    os.environ.update(SCREENLESS)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
