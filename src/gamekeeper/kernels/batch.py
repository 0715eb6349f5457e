"""A batch: many copies of one kernel, stepped together, their arrays at hand."""

from __future__ import annotations

import math
import os
import threading
import time
import weakref
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.kernels.array_views import places_of, tables_of
from gamekeeper.kernels.blake2b import row_digests
from gamekeeper.kernels.driver import driver_of, plain_driver
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_arrays import Arrays, Made, arrays_of, write_snapshot
from gamekeeper.kernels.legality import refuse
from gamekeeper.kernels.scalar_rules import numba
from gamekeeper.randomness.seeds import EpisodeSeeds

DIGEST_SIZE: Final = 16
"""Bytes of a state's digest."""
WORTH_S: Final = 60e-6
"""A step that takes less time in one thread isn't shared: waking another one takes 10 us or so."""
TRIES: Final = 4
"""Steps in one thread before that is known; the first may compile."""


class Batch:
    """Copies of one kernel; copy i plays the episodes i, i + num_envs, ... of the run.

    `step` overwrites the arrays that it hands out: `arrays.obs`, `arrays.rewards` and all others
    (see `gamekeeper.kernels.kernel_arrays.Arrays`) are the same memory all the time, so that
    `torch.from_dlpack(batch.arrays.obs)` shows every step without a copy. The state of copy e is
    the bytes of `records[e]`.

    Args:
        seed: of the run.
        autoreset: `same_step` or `next_step`, as `gk.vector.make` has them.
        infos: fills `arrays.infos` at every step.
        threads: that step parts of the batch at once, where a step takes long enough for it to
            pay; the results are the same to the last bit.
        make: makes the arrays; None: they are NumPy's.
    """

    def __init__(
        self,
        kernel: Kernel,
        num_envs: int,
        *,
        seed: int = 0,
        autoreset: str = "same_step",
        infos: bool = False,
        debug: bool = False,
        threads: int = 1,
        make: Made | None = None,
    ) -> None:
        self.kernel, self.num_envs = kernel, num_envs
        self.records: NDArray[Any] = kernel.records(num_envs)
        self.arrays: Arrays = arrays_of(kernel, self.records, make)
        self._tables = tables_of(kernel)
        self._places = places_of(self.records, self._tables, self.arrays)
        is_plain = debug or numba() is None
        self._driver = (
            plain_driver(kernel, self.records, self._tables, self.arrays)
            if is_plain
            else driver_of(kernel)
        )
        self._seeds = EpisodeSeeds(seed)
        self._is_next, self._tells = autoreset == "next_step", infos
        self._crew = Crew(threads) if threads > 1 and not is_plain else None
        self._quickest_s, self._tries = math.inf, TRIES

    def reset(self, seed: int | None = None) -> Any:
        """Every copy begins its first episode of the run; returns the observations."""
        if seed is not None:
            self._seeds = EpisodeSeeds(seed)
        a, seeds = self.arrays, self._seeds
        for array in (a.rewards, a.terms, a.terminated, a.truncated, a.over, a.ended):
            array[...] = 0
        self._driver.begin(self._places, 0, self.num_envs, seeds.pool, seeds.constant, self._tells)
        return a.obs

    def step(self, actions: Any = None) -> tuple[Any, Any, Any, Any]:
        """One step of every copy.

        Args:
            actions: copied into `arrays.actions`, by group where these are a tuple; None: what
                stands there.
        Returns:
            Observations, rewards, terminated, truncated: the batch's own arrays.
        Raises:
            ActionError: a live agent's action is out of its space, or masked out; nothing changed.
        """
        a = self.arrays
        if actions is not None and len(self.kernel.groups) == 1:
            a.actions[...] = actions
        elif actions is not None:
            for array, part in zip(a.actions, actions, strict=True):
                array[...] = part
        self._play(is_next=self._is_next)
        return a.obs, a.rewards, a.terminated, a.truncated

    def play(self) -> None:
        """As `step` under `next_step`, whatever the batch was made with.

        Raises:
            ActionError: as `step`.
        """
        self._play(is_next=True)

    def restart(self) -> None:
        """Copies that are over begin their next episodes; what was paid stands."""
        self._driver.restart(
            self._places,
            0,
            self.num_envs,
            self._seeds.pool,
            self._seeds.constant,
            self.num_envs,
            self._tells,
        )

    def overview(self) -> NDArray[Any]:
        """The state of every copy as `state()` gives it, [copy, ...]; the batch's own array."""
        self._driver.overview(self._places, 0, self.num_envs)
        states: NDArray[Any] = self.arrays.state
        return states

    def _play(self, *, is_next: bool) -> None:
        if not self._driver.judge(self._places, 0, self.num_envs):
            refuse(self.kernel, self.arrays)
        rest = self._seeds.pool, self._seeds.constant, self.num_envs, is_next, self._tells
        if self._crew is None:
            self._driver.step(self._places, 0, self.num_envs, *rest)
        elif self._tries:
            self._try(rest)
        else:
            step, places = self._driver.step, self._places
            self._crew.run(lambda first, last: step(places, first, last, *rest), self.num_envs)

    def _try(self, rest: tuple[Any, ...]) -> None:
        """A step in one thread, by the clock: whether it is worth more threads."""
        start = time.perf_counter()
        self._driver.step(self._places, 0, self.num_envs, *rest)
        self._quickest_s = min(self._quickest_s, time.perf_counter() - start)
        self._tries -= 1
        if not self._tries and self._quickest_s < WORTH_S:
            self._crew = None

    # -- copies as bytes

    def snapshot(self, e: int | None = None) -> bytes:
        """The state of copy e; None: of all copies, one after the other."""
        return self._chosen(e).tobytes()

    def restore(self, snapshot: bytes, e: int | None = None) -> None:
        """Goes on from a snapshot of copy e, or of all; also of another batch of the same kernel.

        The arrays show the state that was put back: nobody was paid, and who had just ended sees
        nothing any more. Where all have ended, a new episode begins with the next step.

        Raises:
            SpecError: it is of another kernel, or of another number of copies.
        """
        chosen = self._chosen(e)
        write_snapshot(chosen, snapshot)
        first = 0 if e is None else e
        last = first + len(chosen)
        a = self.arrays
        for array in (a.rewards, a.terms, a.terminated, a.truncated, a.ended):
            array[first:last] = 0
        self._driver.show(self._places, first, last, self._tells)

    def digest(self) -> NDArray[np.uint8]:
        """A digest of each copy's state, [copy, 16]; equal states have equal ones."""
        return row_digests(self.arrays.raw, DIGEST_SIZE)

    def equal(self, other: Batch) -> NDArray[np.bool_]:
        """Flags of sub-environments in the same state as those of another batch, [copy]."""
        same: NDArray[np.bool_] = (self.arrays.raw == other.arrays.raw).all(axis=1)
        return same

    def _chosen(self, e: int | None) -> NDArray[Any]:
        if e is not None and not 0 <= e < self.num_envs:
            raise SpecError(
                "there is no such copy",
                where="snapshot",
                expected=f"0 to {self.num_envs - 1}",
                actual=repr(e),
                fix="name a sub-environment of this batch",
            )
        return self.records if e is None else self.records[e : e + 1]


Job: TypeAlias = Callable[[int, int], Any]
"""Work on the sub-environments from the first to before the last."""
PARTS: Final = 6
"""Parts of a batch for each thread."""
TOGETHER: Final = 16
"""Parts begin at multiples of it, so that two threads seldom write to one line of memory."""


class Crew:
    """As many threads as are asked for, the caller's among them.

    They end with the crew's owner, or with the process; after a fork they are hired anew.

    Args:
        count: threads, 2 or more.
    """

    def __init__(self, count: int) -> None:
        self.count, self._pid = count, 0
        self._mates: tuple[_Mate, ...] = ()

    def run(self, job: Job, copies: int) -> None:
        """Does the job to all copies, in parts that whichever thread is free takes next.

        A thread that is woken comes late, so parts are smaller than what each has to do.

        Raises:
            Exception: what a job raised, once all are done.
        """
        if self._pid != os.getpid():
            self._hire()
        bounds = parts_of(copies, self.count * PARTS)
        parts = iter(pairwise(bounds))  # handed out one by one, whoever asks

        def share() -> None:
            for first, last in parts:
                job(first, last)

        for mate in self._mates:
            mate.begin(share)
        try:
            share()
        finally:
            for mate in self._mates:
                mate.done.acquire()
        for mate in self._mates:
            if mate.error is not None:
                raise mate.error

    def _hire(self) -> None:
        self._pid = os.getpid()
        self._mates = tuple(_Mate() for _ in range(self.count - 1))
        for number, mate in enumerate(self._mates):
            threading.Thread(
                target=_work, args=(mate,), name=f"gamekeeper-kernel-{number}", daemon=True
            ).start()
            weakref.finalize(self, mate.dismiss)


class _Mate:
    """One other thread: what it is to do, and what came of it."""

    def __init__(self) -> None:
        self.todo, self.done = threading.Lock(), threading.Lock()
        self.todo.acquire()
        self.done.acquire()
        self.job: Callable[[], None] | None = None
        self.error: BaseException | None = None

    def begin(self, job: Callable[[], None]) -> None:
        """Has the thread do a job."""
        self.job, self.error = job, None
        self.todo.release()

    def dismiss(self) -> None:
        """Ends the thread."""
        self.job = None
        self.todo.release()


def _work(mate: _Mate) -> None:
    while True:
        mate.todo.acquire()
        job = mate.job
        if job is None:
            return
        try:
            job()
        except BaseException as error:  # raised where the crew was asked
            mate.error = error
        del job
        mate.job = None
        mate.done.release()


def parts_of(copies: int, count: int) -> list[int]:
    """Bounds of parts, and the end: at most `count` parts, none of them empty."""
    size = -(-copies // count)
    size += -size % TOGETHER
    return [*range(0, copies, size), copies]
