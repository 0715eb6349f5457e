"""A batch: many copies of one kernel, stepped together, their arrays at hand."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.episode_seeds import EpisodeSeeds
from gamekeeper.errors import SpecError
from gamekeeper.kernels.arrays import Arrays, Made, arrays_of
from gamekeeper.kernels.drivers import driver_of, plain_driver
from gamekeeper.kernels.judge import refuse
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.places import places_of, tables_of
from gamekeeper.kernels.rules import numba


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
        a = self.arrays
        if not self._driver.judge(self._places, 0, self.num_envs):
            refuse(self.kernel, a)
        self._driver.step(
            self._places, 0, self.num_envs, self._seeds.pool, self._seeds.constant,
            self.num_envs, is_next, self._tells,
        )  # fmt: skip

    def snapshot(self) -> bytes:
        """The state of all copies."""
        return self.records.tobytes()

    def restore(self, snapshot: bytes) -> None:
        """Goes on from a snapshot of a batch of the same kernel and as many copies.

        Raises:
            SpecError: it is of another one.
        """
        if len(snapshot) != self.records.nbytes:
            raise SpecError(
                "a snapshot of other copies",
                where="restore",
                expected=f"{self.records.nbytes} bytes",
                seen=f"{len(snapshot)} bytes",
            )
        self.records[...] = np.frombuffer(snapshot, self.records.dtype)
