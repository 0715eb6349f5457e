"""The recorder: a sink whose own thread hashes, compresses and writes, off the step path."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Collection, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from gamekeeper.core.block import most_rows
from gamekeeper.core.contract import Contract
from gamekeeper.core.evidence import manifest_of
from gamekeeper.core.layout import Layout
from gamekeeper.core.merge import merged_episodes
from gamekeeper.core.press import LEVELS, Press
from gamekeeper.core.tape import GIVEN, TURN, Place, Reel, Tape, take
from gamekeeper.errors import BundleError, EvidenceError, GamekeeperError
from gamekeeper.game.capture.ring import Rings
from gamekeeper.game.door import type_name_of
from gamekeeper.record.files.folder import replace
from gamekeeper.record.files.manifest import FORMAT_VERSION, MANIFEST, render
from gamekeeper.record.files.store import Store
from gamekeeper.record.frames import encode_frame

FLUSH_S: Final = 0.04
FLUSH_TURNS: Final = 4096
MOST_TURNS: Final = 4 * FLUSH_TURNS  # on the tape; beyond, the step waits for the writer
MOST_FRAMES: Final = 32  # waiting to be encoded; beyond, the step waits too
PATIENCE_S: Final = 0.001


class Recorder:
    """Takes what a game puts on the tape and writes it into a bundle.

    The step only appends to the tape. Every 40 ms, or sooner when 4,096 turns wait, the recorder's
    thread takes them off, digests them and hands them to the operating system; a turn is never
    split. A tape of 16,384 turns or a full ring of large observations holds the step back.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        environment: Mapping[str, Any],
        contract: Contract | None = None,
        level: str = "full",
        run_seed: int | None = None,
        terms: tuple[str, ...] = (),
        volatile: Collection[str] = (),
        durable: bool = True,
    ) -> None:
        """Makes the bundle and starts the thread.

        Args:
            durable: what is sealed survives a power cut; False where it is played again then.
        Raises:
            BundleError: the folder can't be made, or something is in it.
            EvidenceError: there is no such level.
        """
        if level not in LEVELS:
            raise EvidenceError(
                "there is no such level", expected=" or ".join(LEVELS), seen=repr(level)
            )
        self.tape, self.layout, self.rings = Tape(), Layout(terms), Rings()
        self._facts: dict[str, Any] = {
            "environment": environment,
            "contract": contract,
            "level": level,
            "run_seed": run_seed,
        }
        # pyarrow imports pandas, where it is installed, with the first array that it makes. That
        # takes from 0.3 s to seconds: here nothing waits for it, in the first flush turns would.
        pa.array([0])
        # absolute: whoever steps may change the working directory before the bundle is sealed
        manifest = manifest_of(layout=self.layout, **self._facts)
        self._store = Store.create(Path(path).absolute(), manifest, durable=durable)
        self._durable = durable
        self._press = Press(self.layout, self.rings.open, level=level, volatile=volatile)
        self._episodes: list[pa.RecordBatch] = []
        self._frames: deque[tuple[int, int, Any]] = deque()
        self._wake, self._closing = threading.Event(), False
        self._failure: BaseException | None = None
        self._is_closed = False
        self._process = os.getpid()
        self._described: object = None
        self._reel: Reel | None = None
        self.at_end: Callable[[], None] | None = None
        """Called before an unclosed recorder is sealed: ends the episode in progress."""
        self.manifest: dict[str, Any] = {}
        self._thread = threading.Thread(target=self._run, name="gamekeeper-recorder", daemon=True)
        self._thread.start()
        _OPEN.add(self)

    @property
    def path(self) -> Any:
        """The folder of the bundle."""
        return self._store.path

    # -- on the step path

    def keep_up(self) -> None:
        """Wakes the writer when a flush is due by turns, and waits while it is far behind.

        Raises:
            BundleError: writing failed, or this process is a fork of the one that records; said at
                the next turn that looks.
        """
        self._check()
        waiting = len(self.tape.turns)
        if waiting >= FLUSH_TURNS * TURN:
            self._wake.set()
            while len(self.tape.turns) > MOST_TURNS * TURN:
                self._check()
                time.sleep(PATIENCE_S)

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Takes a rendered frame; a copy is encoded and written by the thread.

        Raises:
            BundleError: as `keep_up`.
        """
        while len(self._frames) >= MOST_FRAMES:
            self._check()
            self._wake.set()
            time.sleep(PATIENCE_S)
        self._frames.append((episode, turn, frame.copy() if hasattr(frame, "copy") else frame))

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure
        if os.getpid() != self._process:  # a fork has no writer thread
            raise BundleError(
                "a recorded environment was stepped in a fork of the process that records it",
                where=str(self.path),
                mend="record in the process that steps, each into a folder of its own",
            )

    # -- in the thread

    def _run(self) -> None:
        try:
            while not self._closing:
                self._wake.wait(FLUSH_S)
                self._wake.clear()
                self._drain()
            self._drain()
        except BaseException as error:  # handed to the step that looks next, and to close
            self._failure = error
            self._let_go()

    def _drain(self) -> None:
        columns = [*self.layout.columns("obs"), *self.layout.columns("action")]
        rows = most_rows(columns)
        while (reel := take(self.tape, most=FLUSH_TURNS, most_rows=rows)) is not None:
            self._reel = reel
            pressed = self._press.press(reel)
            self._describe()
            for stream, batch in pressed.in_order():
                self._store.append(stream, batch)
                if stream == "episodes":
                    self._episodes.append(batch)
        while self._frames:
            episode, turn, frame = self._frames.popleft()
            suffix, data = encode_frame(frame)
            self._store.write_frame(f"{episode:06d}-{turn:06d}.{suffix}", data)

    def _describe(self) -> None:
        """The manifest of the open bundle names the spaces before the first row that needs them.

        The game seats its agents after the folder was claimed, others join later: without their
        spaces the rows of a killed run couldn't be decoded.
        """
        seats = list(self.layout.order)
        types = {seat.name: type_name_of(seat.action_type) for seat in seats if seat.action_type}
        known = len(seats), self.layout.state is None, not types
        if known != self._described:
            self._described = known
            manifest = manifest_of(layout=self.layout, **self._facts)
            entries = {"format_version": FORMAT_VERSION, "status": "open", "action_types": types}
            data = render({**manifest, **entries})
            replace(self.path / MANIFEST, data, durable=self._durable)

    def _let_go(self) -> None:
        """After a failure: a step that waits for a slot of a ring gets one, and then the error."""
        reel = self._reel  # perhaps half opened; slots that are free twice do no harm any more
        while not self._closing:
            held = () if reel is None else (*reel.given[1::GIVEN], *reel.turns[4::TURN])
            for item in held:
                if item.__class__ is Place:
                    self.rings.release(item)
            reel = take(self.tape, most=FLUSH_TURNS)
            if reel is None:
                time.sleep(FLUSH_S)

    # -- the end

    def close(self) -> None:
        """Waits for the thread, seals the bundle; once only, and never in a fork.

        Ctrl-C while it waits leaves the bundle open; the next call, or the end of the process,
        seals it then.

        Raises:
            BundleError: writing failed; what was written stays, and `gamekeeper recover` seals it.
        """
        if self._is_closed or os.getpid() != self._process:
            return
        self._closing = True
        self._wake.set()
        self._thread.join()
        self._is_closed = True
        _OPEN.discard(self)
        if self._failure is not None:
            self._store.abandon()
            raise self._failure
        episodes = merged_episodes(self._episodes)
        failed = "failed" in episodes["end"].to_pylist()
        self.manifest = {
            **manifest_of(layout=self.layout, episodes=episodes, **self._facts),
            "status": "failed" if failed else "sealed",
        }
        self._store.seal(self.manifest)


_OPEN: weakref.WeakSet[Recorder] = weakref.WeakSet()


@atexit.register
def _seal_the_rest() -> None:
    """Seals what nobody closed before the interpreter ends; its last episode is kept as *cut*."""
    for recorder in list(_OPEN):
        try:
            if recorder.at_end is not None and os.getpid() == recorder._process:
                recorder.at_end()
            recorder.close()
        except GamekeeperError as error:  # others are still to be sealed
            sys.stderr.write(f"{type(error).__name__}: {error}\n")
