"""The recorder: a sink whose own thread hashes, compresses and writes, off the step path."""

from __future__ import annotations

import atexit
import threading
import time
import weakref
from collections.abc import Collection, Mapping
from os import PathLike
from typing import Any, Final

import pyarrow as pa

from gamekeeper.core.contract import Contract
from gamekeeper.core.evidence import manifest_of
from gamekeeper.core.layout import Layout
from gamekeeper.core.merge import merged_episodes
from gamekeeper.core.press import LEVELS, Press
from gamekeeper.core.tape import TURN, Tape, take
from gamekeeper.errors import EvidenceError
from gamekeeper.game.ring import Rings
from gamekeeper.record.frames import encode_frame
from gamekeeper.record.store import Store

FLUSH_S: Final = 0.04
FLUSH_TURNS: Final = 1024
MOST_TURNS: Final = 8 * FLUSH_TURNS  # on the tape; beyond, the step waits for the writer
PATIENCE_S: Final = 0.001


class Recorder:
    """Takes what a game puts on the tape and writes it into a bundle.

    The step only appends to the tape. Every 40 ms, or sooner when 1,024 turns wait, the recorder's
    thread takes them off, digests them and hands them to the operating system; a turn is never
    split. A tape of 8,192 turns or a full ring of large observations holds the step back.
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
    ) -> None:
        """Makes the bundle and starts the thread.

        Raises:
            BundleError: the folder can't be made, or something is in it.
            EvidenceError: there is no such level.
        """
        if level not in LEVELS:
            raise EvidenceError(
                "there is no such level", expected=" or ".join(LEVELS), seen=repr(level)
            )
        self.tape, self.layout, self.rings = Tape(), Layout(terms), Rings()
        self._facts = {
            "environment": environment,
            "contract": contract,
            "level": level,
            "run_seed": run_seed,
        }
        self._store = Store.create(path, manifest_of(layout=self.layout, **self._facts))
        self._press = Press(self.layout, self.rings.open, level=level, volatile=volatile)
        self._episodes: list[pa.RecordBatch] = []
        self._frames: list[tuple[int, int, Any]] = []
        self._wake, self._closing = threading.Event(), False
        self._failure: BaseException | None = None
        self._is_closed = False
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
            BundleError: writing failed; said at the next turn that looks.
        """
        if self._failure is not None:
            raise self._failure
        waiting = len(self.tape.turns)
        if waiting >= FLUSH_TURNS * TURN:
            self._wake.set()
            while len(self.tape.turns) > MOST_TURNS * TURN and self._failure is None:
                time.sleep(PATIENCE_S)

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Takes a rendered frame; a copy is encoded and written by the thread."""
        self._frames.append((episode, turn, frame.copy() if hasattr(frame, "copy") else frame))

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

    def _drain(self) -> None:
        while (reel := take(self.tape, most=FLUSH_TURNS)) is not None:
            for stream, batch in self._press.press(reel).in_order():
                self._store.append(stream, batch)
                if stream == "episodes":
                    self._episodes.append(batch)
        frames, self._frames = self._frames, []
        for episode, turn, frame in frames:
            suffix, data = encode_frame(frame)
            self._store.write_frame(f"{episode:06d}-{turn:06d}.{suffix}", data)

    # -- the end

    def close(self) -> None:
        """Waits for the thread, seals the bundle; a second call does nothing.

        Raises:
            BundleError: writing failed; what was written stays, and `gamekeeper recover` seals it.
        """
        if self._is_closed:
            return
        self._is_closed = True
        _OPEN.discard(self)
        self._closing = True
        self._wake.set()
        self._thread.join()
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
    """Seals what nobody closed before the interpreter ends."""
    for recorder in list(_OPEN):
        recorder.close()
