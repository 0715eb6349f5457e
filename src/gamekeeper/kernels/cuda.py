"""A batch of copies of one kernel on a CUDA device."""

from typing import Any, Final

import numpy as np

from gamekeeper.errors import ActionError, DependencyError, check_choice
from gamekeeper.kernels.array_views import leaves, tables_of
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_arrays import Arrays, arrays_of, write_snapshot
from gamekeeper.kernels.legality import refuse
from gamekeeper.randomness.seeds import EpisodeSeeds

CHECKS: Final = ("each", "later", "never")


class CudaBatch:
    """Copies of one kernel, stepped together on a CUDA device; the counterpart of `Batch`.

    Copy i plays the episodes i, i + num_envs, ... of the run, with the seeds and draws that they
    have on any engine. `arrays` are on the device and always the same memory: torch sees every step
    through `torch.from_dlpack(batch.arrays.obs)` without a copy, and may write what comes next
    into `torch.from_dlpack(batch.arrays.actions)`. All work is on the default stream, as torch's.

    Args:
        kernel, num_envs, seed, autoreset, infos: as of `Batch`.
        checks: of actions. `each`: a step with an illegal one raises, and nothing has changed; this
            waits for the device. `later`: nothing waits; such a step and all after it do nothing,
            until `check` raises. `never`: rules index by what they are given, for actions that are
            drawn from the masks.
        threads: of a block, one for each copy.
    Raises:
        DependencyError: the extra `cuda`, or a device, isn't there.
        SpecError: an argument isn't one of those above.
    """

    def __init__(
        self,
        kernel: Kernel,
        num_envs: int,
        *,
        checks: str = "each",
        threads: int = 64,
        seed: int = 0,
        autoreset: str = "same_step",
        infos: bool = False,
    ) -> None:
        autoresets = ("same_step", "next_step")
        check_choice(autoreset, autoresets, "a batch has no such autoreset", where="autoreset")
        check_choice(checks, CHECKS, "a batch has no such checks", where="checks")
        code = require_device()
        self.kernel, self.num_envs, self._checks = kernel, num_envs, checks
        self._seeds = EpisodeSeeds(seed)
        self._is_next, self._tells = autoreset == "next_step", infos
        self._records = kernel.records(num_envs)
        self._host, tables = arrays_of(kernel, self._records), tables_of(kernel)
        self._wrong = np.full(1, code.NOBODY, np.int64)
        self._memory, self._put, self._nobody = code.Memory(), code.put, code.NOBODY
        counterparts = self._memory.counterparts
        self.records, self.arrays, self._flag = map(
            counterparts, (self._records, self._host, self._wrong)
        )
        self._tables = counterparts(np.array(tables))
        found = [self.records, self._tables, *leaves(self.arrays)]
        self._at = np.array([code.address(array) for array in found], np.int64)
        self._places = counterparts(self._at)
        if code.IS_SIMULATED:
            self._code = code.simulated(kernel, self._records, tables, self._host)
        else:
            self._code = code.code_of(kernel)
        self._grid = -(-num_envs // threads), threads
        self._graph_of, self._quiet = code.graph_of, code.quiet
        self._play: tuple[Any, Any] | None = None

    def reset(self, seed: int | None = None) -> Any:
        """Every copy begins its first episode of the run; returns the observations."""
        if seed is not None:
            self._seeds, self._play = EpisodeSeeds(seed), None
        self._forgive()
        seeds = self._seeds
        with self._quiet():
            self._code.begin[self._grid](
                self._places, self.num_envs, seeds.pool, seeds.constant, self._tells
            )
        return self.arrays.obs

    def step(self, actions: Any = None) -> tuple[Any, Any, Any, Any]:
        """One step of every copy.

        Args:
            actions: arrays of the host or the device, copied into `arrays.actions`; None: what
                stands there.
        Returns:
            Observations, rewards, terminated, truncated: the batch's own arrays, on the device.
        Raises:
            ActionError: a live agent's action is out of its space, or masked out (see `checks`).
        """
        a = self.arrays
        if actions is not None:
            mine, given = a.actions, actions
            if not isinstance(mine, tuple):
                mine, given = (mine,), (given,)
            for place, values in zip(mine, given, strict=True):
                self._put(place, values)
        judge, step = self._play = self._play or self._prepared()
        if judge is not None:
            judge()
            self.check()
        step()
        return a.obs, a.rewards, a.terminated, a.truncated

    def _prepared(self) -> tuple[Any, Any]:
        """Functions that judge, where a step waits for it, and play a step of the run's seeds."""
        code, seeds, grid = self._code, self._seeds, self._grid

        def judge(stream: Any) -> None:
            code.judge[(*grid, stream)](self._places, self.num_envs, self._flag)

        def step(stream: Any) -> None:
            code.step[(*grid, stream)](
                self._places,
                self.num_envs,
                self._flag,
                seeds.pool,
                seeds.constant,
                self.num_envs,
                self._is_next,
                self._tells,
            )

        if self._checks == "each":
            return self._graph_of(judge), self._graph_of(step)
        return None, self._graph_of(*([judge] if self._checks == "later" else []), step)

    def check(self) -> None:
        """Waits for all steps so far; afterwards the batch takes steps again.

        Raises:
            ActionError: one of them had an illegal action; it and those after it did nothing.
        """
        self._memory.pull(self._wrong)
        wrong = int(self._wrong[0])
        if wrong == self._nobody:
            return
        self._forgive()
        if self._checks == "each":
            refuse(self.kernel, self.host())
        raise ActionError(  # those that it was are overwritten by now
            "an action wasn't legal",
            where=f"copy {wrong}, a step since the last check",
            fix='checks="each" names the agent and its action',
        )

    def host(self) -> Arrays:
        """All arrays as they are now, on the host: the same memory at each call."""
        self._memory.pull()
        return self._host

    def snapshot(self) -> bytes:
        """The state of all copies, the same bytes as those of a `Batch`."""
        self._memory.pull(self._records)
        return self._records.tobytes()

    def restore(self, snapshot: bytes) -> None:
        """Goes on from a snapshot of a batch of the same kernel and as many copies, of any engine.

        Raises:
            SpecError: it is of another one.
        """
        write_snapshot(self._records, snapshot)
        self._memory.push(self._records)

    def _forgive(self) -> None:
        self._wrong[0] = self._nobody
        self._memory.push(self._wrong)


def require_device() -> Any:
    """The module that compiles for and holds memory on a device that is there.

    Raises:
        DependencyError: Numba's CUDA target, or a device, isn't there.
    """
    try:
        from gamekeeper.kernels import cuda_code
    except ImportError as error:
        raise DependencyError(
            "kernels run on CUDA with Numba alone",
            actual=str(error),
            fix="pip install 'gamekeeper[cuda]'",
        ) from error
    if not cuda_code.cuda.is_available():
        raise DependencyError(
            "there is no CUDA device",
            expected="an NVIDIA device and its driver",
            actual="none",
            fix="Batch(kernel, ...) plays on the processor's cores; NUMBA_ENABLE_CUDASIM=1 "
            "simulates a device, for tests",
        )
    return cuda_code
