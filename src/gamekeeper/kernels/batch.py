"""A batch: many copies of one kernel, stepped together, their arrays at hand."""

from __future__ import annotations

import math
import time
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.episode_seeds import EpisodeSeeds
from gamekeeper.errors import SpecError
from gamekeeper.kernels.arrays import Arrays, Made, arrays_of
from gamekeeper.kernels.crew import Crew
from gamekeeper.kernels.drivers import driver_of, plain_driver
from gamekeeper.kernels.hashing import row_digests
from gamekeeper.kernels.judge import refuse
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.places import places_of, tables_of
from gamekeeper.kernels.rules import numba

DIGEST_SIZE: Final = 16
"""Bytes of a state's digest."""
WORTH_S: Final = 60e-6
"""A step that takes less time in one thread isn't shared: waking another one takes 10 us or so."""
TRIES: Final = 4
"""Steps in one thread before that is known; the first may compile."""


class Batch:
    """Copies of one kernel; copy i plays the episodes i, i + num_envs, ... of the run.

    `step` overwrites the arrays that it hands out: `arrays.obs`, `arrays.rewards` and all others
    (see `gamekeeper.kernels.arrays.Arrays`) are the same memory all the time, so that
    `torch.from_dlpack(batch.arrays.obs)` shows every step without a copy. The state of copy e is
    the bytes of `records[e]`.

    Args:
        kernel: whose copies.
        num_envs: how many.
        seed: of the run.
        autoreset: `same_step` or `next_step`, as `gk.vector.make` has them.
        infos: fills `arrays.infos` at every step.
        debug: plain Python, for breakpoints in the rules.
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
            self._places, 0, self.num_envs, self._seeds.pool, self._seeds.constant,
            self.num_envs, self._tells,
        )  # fmt: skip

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
        if len(snapshot) != chosen.nbytes:
            raise SpecError(
                "a snapshot of other copies",
                where="restore",
                expected=f"{chosen.nbytes} bytes",
                seen=f"{len(snapshot)} bytes",
            )
        chosen[...] = np.frombuffer(snapshot, self.records.dtype)
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
        """Which copies are in the same state as those of another batch of the kernel, [copy]."""
        same: NDArray[np.bool_] = (self.arrays.raw == other.arrays.raw).all(axis=1)
        return same

    def _chosen(self, e: int | None) -> NDArray[Any]:
        if e is not None and not 0 <= e < self.num_envs:
            raise SpecError(
                "there is no such copy",
                where="snapshot",
                expected=f"0 to {self.num_envs - 1}",
                seen=repr(e),
            )
        return self.records if e is None else self.records[e : e + 1]
