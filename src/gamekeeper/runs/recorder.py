"""Recorders: of one environment by a thread of its own, of many sub-environments, of frames."""

import atexit
import io
import os
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Collection, Mapping
from contextlib import ContextDecorator
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.contract import Contract
from gamekeeper.episodes.block import most_rows
from gamekeeper.episodes.buffer import (
    GIVEN,
    TURN,
    Buffer,
    BufferedTurns,
    Counts,
    LargePlace,
    added,
    take,
)
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.encoder import KEPT, LEVELS, Encoder
from gamekeeper.episodes.evidence import manifest_of
from gamekeeper.episodes.layout import Column, Layout
from gamekeeper.errors import (
    DependencyError,
    EvidenceError,
    GamekeeperError,
    RunError,
    check_choice,
)
from gamekeeper.interface.capture import type_name_of
from gamekeeper.interface.packing import Rings
from gamekeeper.runs import own_runs
from gamekeeper.runs.files.store import RunStore
from gamekeeper.runs.first_check import unchecked
from gamekeeper.runs.ring.ring_ledger import RingLedger
from gamekeeper.runs.ring.ring_store import create_ring
from gamekeeper.terminal import say

# -- Rendered frames as files


def encode_frame(frame: Any) -> tuple[str, bytes]:
    """A frame as suffix and bytes of a file: PNG, text, or canonical JSON of what is neither.

    Args:
        frame: [height, width, 3 or 4] uint8, or a text.
    Raises:
        DependencyError: Pillow isn't installed.
    """
    if isinstance(frame, str):
        return "txt", frame.encode(errors="replace")
    is_picture = (
        isinstance(frame, np.ndarray)
        and frame.dtype == np.uint8
        and frame.ndim == 3
        and frame.shape[2] in (3, 4)
        and frame.size > 0
    )
    if not is_picture:
        return "json", to_json(frame).encode(errors="replace")
    buffer = io.BytesIO()
    image = require_pillow().fromarray(np.ascontiguousarray(frame))
    image.save(buffer, "PNG", compress_level=1)
    return "png", buffer.getvalue()


def require_pillow() -> Any:
    """`PIL.Image`, which writes frames that are pictures.

    Raises:
        DependencyError: Pillow isn't installed.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise DependencyError(
            "frames are written with Pillow, which isn't installed",
            fix="pip install 'gamekeeper[frames]', or record without frames",
        ) from error
    return Image


# -- The recorder: a sink whose own thread hashes, compresses and writes, off the step path

FLUSH_S: Final = 0.04  # at the latest what came is safe from a kill
ENCODE_S: Final = 4.0  # at the latest it is encoded; until then it is in the journal
ENCODE_ROWS: Final = 8192
ENCODE_BYTES: Final = 1 << 20
FLUSH_TURNS: Final = 4096
MOST_TURNS: Final = 4 * FLUSH_TURNS  # on the buffer; beyond, the step waits for the writer
MOST_FRAMES: Final = 32  # waiting to be encoded; beyond, the step waits too
PATIENCE_S: Final = 0.001
SWITCH_S: Final = 0.0005
"""Longest time that the writer waits for the interpreter, each time that an array was copied.

Python's own 5 ms make half a second of a flush, as arrays are copied without the interpreter.
"""


class _Prompt(ContextDecorator):
    """Lets writers have the interpreter soon while any of them flushes; as before afterwards."""

    def __init__(self) -> None:
        self._lock, self._count, self._before_s = threading.Lock(), 0, 0.0

    def __enter__(self) -> None:
        with self._lock:
            if not self._count:
                self._before_s = sys.getswitchinterval()
                sys.setswitchinterval(min(self._before_s, SWITCH_S))
            self._count += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._count -= 1
            if not self._count:
                sys.setswitchinterval(self._before_s)


_PROMPT: Final = _Prompt()


class RunRecorder:
    """Takes rows off the buffer that a capture fills, and writes them into a run.

    The step only appends to the buffer. Every 40 ms, or sooner when 4,096 turns wait, the
    recorder's thread takes them off, digests them and hands them to the operating system; a turn
    is never split. A buffer of 16,384 turns or a full ring of large observations holds the step
    back.
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
        is_timed: bool = True,
        extra: Mapping[str, Any] | None = None,
        ring: RingLedger | None = None,
    ) -> None:
        """Makes the run and starts the thread.

        Args:
            durable: the finalized run survives a power cut; False where it is recorded again.
            is_timed: keep the wall time of each step.
            extra: further entries of the manifest.
            ring: says which episodes stay; None: all.
        Raises:
            RunError: the folder can't be made, or something is in it.
            EvidenceError: there is no such level.
        """
        what = "there is no such level"
        check_choice(level, LEVELS, what, where="level", error=EvidenceError)
        self.buffer, self.layout, self.rings = Buffer(), Layout(terms), Rings()
        self.level = level
        self._facts: dict[str, Any] = {
            "environment": environment,
            "contract": contract,
            "level": level,
            "run_seed": run_seed,
            "layout": self.layout,
            "extra": extra,
        }
        self._is_timed = is_timed
        # absolute: the environment may change the working directory before the run is finalized
        manifest = manifest_of(**self._facts)
        self._ring = ring
        self._store = _created(path, manifest, ring, durable=durable)
        self._encoder = Encoder(self.layout, self.rings.open, level=level, volatile=volatile)
        self._frames: deque[tuple[int, int, Any]] = deque()
        self._wake, self._closing = threading.Event(), False
        self._failure: BaseException | None = None
        self._is_closed = False
        self._process = os.getpid()
        self._described: object = None
        self._journaled, self._encoded_at, self._flushed_at = Counts(), time.monotonic(), 0.0
        self._buffered: BufferedTurns | None = None
        self.after_flush: Callable[[BufferedTurns], None] = no_watch
        """Called in the thread once buffered turns are written."""
        self.at_end: Callable[[], None] | None = None
        """Called before an unclosed recorder is finalized: ends the episode in progress."""
        self.manifest: dict[str, Any] = {}
        self._thread = threading.Thread(target=self._run, name="gamekeeper-recorder", daemon=True)
        self._thread.start()
        _OPEN.add(self)

    @property
    def path(self) -> Any:
        """The folder of the run."""
        return self._store.path

    def say_in_manifest(self, **entries: Any) -> None:
        """Adds entries to the manifest that finalizes the run."""
        self._facts["extra"] = {**(self._facts["extra"] or {}), **entries}

    # -- on the step path

    def keep_up(self) -> None:
        """Wakes the writer when enough turns wait, and waits while it is far behind.

        Raises:
            RunError: writing failed, or this process is a fork of the one that records; raised at
                a later turn.
        """
        self._check()
        waiting = len(self.buffer.turns)
        if waiting >= FLUSH_TURNS * TURN:
            self._wake.set()
            while len(self.buffer.turns) > MOST_TURNS * TURN:
                self._check()
                time.sleep(PATIENCE_S)

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Takes a rendered frame; a copy is encoded and written by the thread.

        Raises:
            RunError: as `keep_up`.
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
            raise RunError(
                "a recorded environment was stepped in a fork of the process that records it",
                where=str(self.path),
                fix="record in the process that steps, each into a folder of its own",
            )

    # -- in the thread

    def _run(self) -> None:
        try:
            begun = time.monotonic()
            while not self._closing:
                self._wake.wait(FLUSH_S - (time.monotonic() - begun))
                self._wake.clear()
                begun = time.monotonic()
                self._flush()
            self._flush()
        except BaseException as error:  # handed to the step that looks next, and to close
            self._failure = error
            self._let_go()

    @_PROMPT
    def _flush(self) -> None:
        now = time.monotonic()
        is_early = now - self._flushed_at < FLUSH_S / 2  # many turns: encoding will take them soon
        self._flushed_at = now
        # the journal first: what comes while columns are made waits no longer than always
        if not (is_early and self._is_due()) and self._journal() and not self._is_due():
            return
        self._encode()
        while self._frames:
            episode, turn, frame = self._frames.popleft()
            suffix, data = encode_frame(frame)
            self._store.write_frame(f"{episode:06d}-{turn:06d}.{suffix}", data)

    def _is_due(self) -> bool:
        """True if what waits is to be encoded: much of it, or since long."""
        buffer = self.buffer
        rows = len(buffer.given) // GIVEN + len(buffer.usual.agents)
        return (
            self._closing
            or bool(self._frames)
            or rows >= most_rows(self._columns(), ENCODE_ROWS, ENCODE_BYTES)
            or len(buffer.turns) >= FLUSH_TURNS * TURN
            or time.monotonic() - self._encoded_at >= ENCODE_S
        )

    def _columns(self) -> list[Column]:
        return [*self.layout.columns("obs"), *self.layout.columns("action")]

    def _journal(self) -> bool:
        """Copies into the journal what came since the last time; False where it can't hold it."""
        turns, counts = added(self.buffer, self._journaled)
        if counts == self._journaled:
            return True
        self._describe()
        if not self._store.journal.write(turns, self.layout, is_timed=self._is_timed):
            return False
        self._journaled = counts
        return True

    def _encode(self) -> None:
        rows = most_rows(self._columns())
        taken, waiting = 0, len(self.buffer.turns)  # what comes meanwhile waits
        while (buffered := take(self.buffer, most=FLUSH_TURNS, most_rows=rows)) is not None:
            self._buffered = buffered
            if self._ring is not None and self.level == KEPT:
                self._ring.add_infos(buffered, self.layout)
            encoded = self._encoder.encode_turns(buffered)
            self._describe()
            for stream, batch in encoded.in_order():
                if stream == "timings" and not self._is_timed:
                    continue
                self._store.append(stream, batch)
            taken += len(buffered.turns)
            if taken >= self._journaled.turns * TURN:  # all that the journal holds
                self._store.journal.clear()
                self._journaled = Counts()
            self.after_flush(buffered)
            if taken >= waiting:
                break
        self._encoded_at = time.monotonic()

    def _describe(self) -> None:
        """Names the spaces in the open run's manifest before the first row that needs them.

        Agents are announced after the folder was claimed, others join later: without their spaces
        the rows of a killed run couldn't be decoded.
        """
        agents = list(self.layout.order)
        has_types = any(each.action_type for each in agents)  # most often the first has one
        known = len(agents), self.layout.state is None, has_types
        if known != self._described:
            self._described = known
            types = {
                each.name: type_name_of(each.action_type) for each in agents if each.action_type
            }
            self._store.describe({**manifest_of(**self._facts), "action_types": types})

    def _let_go(self) -> None:
        """Frees slots of the rings after a failure: a step that waits for one gets the error."""
        # its large observations were perhaps opened; a slot that is freed twice does no harm now
        buffered = self._buffered
        while not self._closing:
            held = () if buffered is None else (*buffered.given[1::GIVEN], *buffered.turns[6::TURN])
            for item in held:
                if item.__class__ is LargePlace:
                    self.rings.release(item)
            buffered = take(self.buffer, most=FLUSH_TURNS)
            if buffered is None:
                time.sleep(FLUSH_S)

    # -- the end

    def close(self) -> None:
        """Waits for the thread, finalizes the run; once only, and never in a fork.

        Ctrl-C while it waits leaves the run open; the next call, or the end of the process,
        finalizes it then.

        Raises:
            RunError: writing failed; what was written stays, and `gamekeeper recover` finalizes it.
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
        self.manifest = _finalized(self._store, self._facts)
        own_runs.remember(self.path)


def no_watch(buffered: BufferedTurns) -> None:
    """Does nothing with turns that are written."""


def _created(
    path: str | PathLike[str], manifest: dict[str, Any], ring: RingLedger | None, *, durable: bool
) -> RunStore:
    """Writer of a run that retains all, or what `ring` says."""
    # pyarrow imports pandas, where it is installed, with the first array that it makes. That takes
    # from 0.3 s to seconds: nothing waits for it here, but turns would in the first flush
    pa.array([0])
    folder = Path(path).absolute()
    if ring is None:
        return RunStore.create(folder, manifest, durable=durable)
    return create_ring(folder, manifest, ring, durable=durable)


def _finalized(store: RunStore, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Finalizes a run that ended; its manifest, by the rows of its episodes."""
    try:
        episodes, entries = store.settle()
        status = "failed" if "failed" in episodes["end"].to_pylist() else "finalized"
        manifest = {**manifest_of(episodes=episodes, **facts), **entries, "status": status}
        store.finalize(manifest)
    except BaseException:
        store.abandon()
        raise
    return manifest


_OPEN: weakref.WeakSet[RunRecorder] = weakref.WeakSet()


@atexit.register
def _finalize_the_rest() -> None:
    """Finalizes runs still open when the interpreter ends; their last episode is *cut*."""
    for recorder in list(_OPEN):
        try:
            if recorder.at_end is not None and os.getpid() == recorder._process:
                recorder.at_end()
            recorder.close()
        except GamekeeperError as error:  # others are still to be finalized
            say(f"{type(error).__name__}: {error}")


# -- Recording many sub-environments: one run, its episodes in their order whatever the timing


def record_many(
    venv: Any,
    path: str | PathLike[str],
    *,
    level: str,
    contract: Contract | None,
    ring: RingLedger | None = None,
) -> None:
    """Records a vector environment into a run from its next reset on; closing it finalizes that.

    The fingerprint is the one that the same episodes have, played one by one. Rows reach the disk
    in the order of episodes, so those after an episode that is still being played wait in memory.

    Args:
        venv: a vector environment that wasn't reset yet.
        path: a folder that doesn't exist yet, or is empty.
        level: as in `record`.
        contract: names reward terms and volatile infos; None: the environment's own.
        ring: says which episodes stay; None: all.
    Raises:
        RunError: the folder can't be written, or something is in it.
        OrderError: it was reset already.
    """
    declared = venv.seen.contract if contract is None else contract
    facts: dict[str, Any] = {
        "environment": venv.seen.identity,
        "contract": declared,
        "level": level,
        "run_seed": None,
        "layout": venv.seen.layout,
        "extra": {"checked": unchecked("copies aren't")} if level == KEPT else None,
    }
    store = _created(path, manifest_of(**facts), ring, durable=True)

    def finalize() -> None:
        _finalized(store, facts)
        own_runs.remember(store.path)

    try:
        venv.record(
            store.append,
            level=level,
            terms=() if declared is None else tuple(declared.rewards),
            volatile=() if declared is None else tuple(declared.volatile_infos()),
            on_close=finalize,
        )
    except BaseException:
        store.abandon()
        raise
