"""Every render mode but "human", built, played and filmed beside the same play without a camera."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from gamekeeper.audit.lab import Called, Lab, Saw
from gamekeeper.audit.probes._moves import affordable, moves
from gamekeeper.core.divergence import compare
from gamekeeper.core.gathered import Twin
from gamekeeper.game.capture.oddity import type_name_of
from gamekeeper.run.episode import Play, Played

SHARE: Final = 1.5
MOST_MODES: Final = 3
MOST_TURNS: Final = 40
"""Of a film; rendering is slow."""
WRITTEN_TURNS: Final = 6
"""Turns at which frames are written into."""
LATE_TURNS: Final = 2
"""The last turns, at which an instance is asked for its first frame."""
KEPT_BYTES: Final = 32 << 20
"""Frames that are kept to be looked at once more."""
SCREENLESS: Final = {"SDL_VIDEODRIVER": "dummy", "SDL_AUDIODRIVER": "dummy", "MPLBACKEND": "Agg"}
NEEDS_MORE: Final = re.compile(
    r"display|opengl|\bglx?\b|\begl\b|x11|xcb|screen|not ?installed|ImportError|ModuleNotFound",
    re.IGNORECASE,
)
"""What is said where a screen or a package is missing; that is no fault of the environment."""


def plays(lab: Lab) -> Iterator[Play]:
    """Two; each is played a handful of times."""
    yield from lab.plays(2, runs=7, most_turns=affordable(lab, MOST_TURNS))


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """A mode's instance beside the plain one, and a film beside the same without a camera.

    Twins:
        `RenderMode`: built with another mode, or with None, never rendered.
        `Rendered`: rendered at every turn, beside the same mode never rendered.

    Facts:
        `mode`: whether it could be built, and what `env.render_mode` says: `mode`, `taken` (the
            factory takes the argument), `is_own`, `options`, `failed`, `is_missing` (a screen or a
            package is), `shown`.
        `film`: `mode`, `options`, `moves` (turns at which somebody's observation changed), `shots`
            by turn; a shot has `turn`, `over`, `failed`, `kind`, `frames` ([dtype, shape] of each
            array), `digest`.
        `kept`: frames that are no longer what they were when they were handed out: `turns`, of
            `count`.
        `written`: turns at which a frame was another once the one before was written into: `turns`,
            of `count`.
        `late`: `turn` and `digest` of the first frame that an instance was asked for; of the last
            turns, and of those since which the film has shown the same. None where its play was
            another than the film's: their moments are not the same then.
        `again`: `digest` of the frame after a second reset with the same seed, where plays repeat.
    """
    with _screenless():
        env = lab.env()
        own = getattr(env, "render_mode", None)
        metadata = getattr(env, "metadata", None)
        base = lab.play(play, env)
        if base.failed is not None and play.actions is not None:
            return  # a shorter play that breaks off shows another thing
        sham = lab.play(base.play)
        takes = lab.can_make and lab.call("make", lab.make, render_mode=None).failed is None
        if takes and own is not None:
            yield _twin("RenderMode", None, base, sham, lab.play(base.play, _plain(lab)), lab)
        for mode in _modes(metadata, own):
            yield from _mode(lab, mode, own=own, takes=takes, base=base, sham=sham)


def _mode(
    lab: Lab, mode: str, *, own: Any, takes: bool, base: Played, sham: Played
) -> Iterator[Saw]:
    is_own = mode == own
    options = {} if is_own else {"render_mode": mode}

    def built() -> Called:
        return Called(lab.env()) if is_own else lab.call("make", lab.make, **options)

    about = {"mode": mode, "taken": takes or is_own, "is_own": is_own, "options": options}
    if not (takes or is_own):
        yield lab.fact("mode", {**about, "failed": None, "is_missing": False, "shown": None})
        return
    made = built()
    said = None if made.failed is None else _first_line(made.failed.text)
    shown = getattr(made.value, "render_mode", None)
    yield lab.fact(
        "mode", {**about, "failed": said, "is_missing": _is_missing(said), "shown": shown}
    )
    if made.failed is not None:
        return
    still = base
    if not is_own:
        still = lab.play(base.play, made.value)
        yield _twin("RenderMode", mode, base, sham, still, lab)
        made = built()
    camera = Camera(lab)
    filmed = lab.play(base.play, made.value, watch=camera)
    yield _twin("Rendered", mode, still, sham, filmed, lab)
    yield lab.fact(
        "film", {**about, "shots": camera.shots, "moves": moves(filmed.trace)}, field="render"
    )
    yield lab.fact("kept", {**about, "turns": camera.changed(), "count": len(camera.kept)})
    volatile = lab.contract.volatile_infos()
    if compare(base.trace, sham.trace, volatile=volatile).divergence is None:
        yield from _looked_twice(lab, about, base.play, made.value)
    turns = len(base.play.actions or ())
    last = range(max(turns - LATE_TURNS + 1, 1), turns + 1)
    for first in sorted({*last, *(_since(camera.shots, turn) for turn in last)} - {0}):
        late = Camera(lab, first=first)
        again = lab.play(base.play, built().value, watch=late)
        is_same = compare(filmed.trace, again.trace, volatile=volatile).divergence is None
        for shot in late.shots[:1] if is_same else ():
            yield lab.fact("late", {**about, "turn": first, "digest": shot["digest"]})
    pen = Pen(lab)
    lab.play(_shorter(base.play), built().value, watch=pen)
    yield lab.fact("written", {**about, "turns": pen.turns, "count": pen.count})


def _looked_twice(lab: Lab, about: dict[str, Any], play: Play, env: Any) -> Iterator[Saw]:
    """The first frame of a second episode in the instance that was filmed."""
    if lab.call("reset", env.reset, seed=play.seed, options=play.options).failed is None:
        digest = _shot(lab.call("render", env.render))["digest"]
        yield lab.fact("again", {**about, "digest": digest})


def _since(shots: list[dict[str, Any]], turn: int) -> int:
    """The first of the turns in a row, this one the last, at which a film shows the same."""
    shown = {shot["turn"]: shot["digest"] for shot in shots}
    while turn - 1 in shown and shown[turn - 1] == shown.get(turn):
        turn -= 1
    return turn


class Camera:
    """Renders after the reset and after every crossing, from turn `first` on."""

    def __init__(self, lab: Lab, first: int = 0) -> None:
        self.shots: list[dict[str, Any]] = []
        self.kept: list[tuple[int, Any, str]] = []
        self._lab, self._first, self._bytes = lab, first, 0

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """One frame."""
        if turn < self._first:
            return
        called = self._lab.call("render", env.render)
        shot = {"turn": turn, "over": not env.agents, **_shot(called)}
        self.shots.append(shot)
        self._bytes += sum(frame.nbytes for frame in _arrays(called.value))
        if shot["digest"] is not None and shot["frames"] and self._bytes < KEPT_BYTES:
            self.kept.append((turn, called.value, shot["digest"]))

    def changed(self) -> list[int]:
        """Turns whose frames are no longer what they were."""
        return [turn for turn, frame, digest in self.kept if _digest(frame) != digest]


class Pen:
    """Writes into the frames of a moment, and looks whether the next frame of it shows that."""

    def __init__(self, lab: Lab) -> None:
        self.turns: list[int] = []
        self.count = 0
        self._lab = lab

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """Two frames of one moment, which agree; a third after writing into them."""
        frames = [_arrays(self._lab.call("render", env.render).value) for _ in range(2)]
        before = [[array.copy() for array in each] for each in frames]
        if not before[0] or _digest(before[0]) != _digest(before[1]):
            return
        pairs = [pair for each in frames for pair in zip(each, before[0], strict=True)]
        if not all(_can_write(array) for array, _ in pairs):
            return
        for array, old in pairs:  # both frames may be one array
            array[...] = _scribble(old)
        self.count += 1
        after = _arrays(self._lab.call("render", env.render).value)
        if _is_shown(before[0], after):
            self.turns.append(turn)


def _is_shown(before: list[Any], after: list[Any]) -> bool:
    """Whether a frame differs from the one before, and that by what was written into that one."""
    differing = written = 0
    for old, new in zip(before, after, strict=False):
        if old.shape == new.shape:
            differing += int((new != old).sum())
            written += int(((new != old) & (new == _scribble(old))).sum())
    return written > 0 and written >= 0.9 * differing


def _shot(called: Called) -> dict[str, Any]:
    said = None if called.failed is None else f"{called.failed.kind}: {called.failed.text}"
    return {
        "failed": said,
        "is_missing": _is_missing(said),
        "kind": type_name_of(type(called.value)),
        "frames": [[a.dtype.name, list(a.shape)] for a in _arrays(called.value)],
        "digest": _digest(called.value),
    }


def _arrays(frame: Any) -> list[Any]:
    """The arrays that a frame consists of."""
    items = frame if isinstance(frame, list | tuple) else [frame]
    return [item for item in items if isinstance(item, np.ndarray)]


def _digest(frame: Any) -> str | None:
    """Of a frame's arrays or text; None where it is neither."""
    if isinstance(frame, str):
        return hashlib.blake2b(frame.encode("utf-8", "replace"), digest_size=16).hexdigest()
    arrays = _arrays(frame)
    if not arrays or any(array.dtype == object for array in arrays):
        return None
    hashed = hashlib.blake2b(digest_size=16)
    for array in arrays:
        hashed.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return hashed.hexdigest()


def _can_write(array: Any) -> bool:
    return bool(array.flags.writeable and array.dtype.kind in "uif" and array.size)


def _scribble(array: Any) -> Any:
    """Another value for every element."""
    return np.where(array == 0, 1, 0)


def _plain(lab: Lab) -> Any:
    return lab.make(render_mode=None)


def _twin(kind: str, mode: str | None, base: Played, sham: Played, other: Played, lab: Lab) -> Twin:
    change = {"change": kind, "mode": mode}
    volatile = tuple(lab.contract.volatile_infos())
    return Twin(base.trace, sham.trace, other.trace, change, volatile)


def _modes(metadata: Any, own: Any) -> list[str]:
    """The declared modes, and the one in use, without "human", which needs a screen."""
    declared = metadata.get("render_modes") if isinstance(metadata, dict) else None
    listed = declared if isinstance(declared, list | tuple) else ()
    named = [mode for mode in (own, *listed) if isinstance(mode, str) and mode != "human"]
    return list(dict.fromkeys(named))[:MOST_MODES]


def _shorter(play: Play) -> Play:
    actions = (play.actions or ())[:WRITTEN_TURNS]
    return Play(play.seed, play.stream, actions, max(len(actions), 1), play.options)


def _first_line(text: str) -> str:
    return text.partition("\n")[0]


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
