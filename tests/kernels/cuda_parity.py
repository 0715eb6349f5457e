"""Compares a CUDA batch with plain Python, bit for bit; run in a process of its own.

Arguments: kernels as `module:name`, `name` a kernel, or a task of ours; then the steps as a number.
With NUMBA_ENABLE_CUDASIM=1 the device is Numba's simulator.
"""

import sys
from importlib import import_module
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import ActionError
from gamekeeper.kernels.array_views import leaves
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.cuda import CudaBatch
from gamekeeper.kernels.kernel import Kernel

ENVS = 3
THREADS = 2  # of a block, so that the last one is not full


def kernel_of(name: str) -> Kernel:
    """The kernel of that name."""
    module, colon, thing = name.partition(":")
    return getattr(import_module(module), thing) if colon else gk.make(name).kernel


def legal(kernel: Kernel, arrays: Any, rng: np.random.Generator) -> Any:
    """Random legal actions of all copies, by group."""
    found = []
    for g, group in enumerate(kernel.groups):
        many = len(kernel.groups) > 1
        masks, mine = (
            (arrays.masks[g], arrays.actions[g]) if many else (arrays.masks, arrays.actions)
        )
        space = group.action_space
        if masks.size:
            flags = np.where(masks.any(-1, keepdims=True), masks, 1)
            found.append(np.argmax(rng.random(flags.shape) * flags, -1))
        elif hasattr(space, "n"):
            found.append(space.start + rng.integers(space.n, size=mine.shape))
        elif hasattr(space, "nvec"):
            found.append(space.start + rng.integers(space.nvec, size=mine.shape))
        else:
            found.append(rng.uniform(-1, 1, mine.shape).astype(mine.dtype))
    return tuple(found) if len(found) > 1 else found[0]


def compare(kernel: Kernel, steps: int, autoreset: str, tolerance: float) -> int:
    """Raises where anything differs; how many episodes ended."""
    options = {"seed": 5, "autoreset": autoreset, "infos": True}
    plain = Batch(kernel, ENVS, debug=True, **options)
    device = CudaBatch(kernel, ENVS, threads=THREADS, **options)
    plain.reset()
    device.reset()
    rng, ended = np.random.default_rng(2), 0
    for step in range(steps):
        actions = legal(kernel, plain.arrays, rng)
        plain.step(actions)
        device.step(actions)
        ended += int(plain.arrays.ended.sum())
        pairs = zip(leaves(plain.arrays), leaves(device.host()), strict=True)
        for mine, theirs in pairs:
            if tolerance and mine.dtype.kind == "f":
                np.testing.assert_allclose(theirs, mine, rtol=tolerance, atol=tolerance)
            elif not tolerance or mine.dtype != np.uint8:
                assert mine.tobytes() == theirs.tobytes(), f"{kernel.name}, step {step}"
    assert tolerance or plain.snapshot() == device.snapshot()
    return ended


def refuses(kernel: Kernel, checks: str) -> None:
    """An action that isn't legal is refused, and the batch goes on as if nothing had happened."""
    device = CudaBatch(kernel, ENVS, threads=THREADS, checks=checks)
    device.reset()
    before = device.snapshot()
    good = legal(kernel, device.host(), np.random.default_rng(0))
    bad = good.copy()
    bad[1] = 9
    with pytest.raises(ActionError, match="copy 1"):
        _bad_then_good(device, bad, good)
    assert device.snapshot() == before
    device.step(good)
    device.check()
    assert device.snapshot() != before
    device.restore(before)
    assert device.snapshot() == before


def _bad_then_good(device: CudaBatch, bad: Any, good: Any) -> None:
    device.step(bad)
    device.step(good)
    device.check()


def main(names: list[str], steps: int, tolerance: float = 0.0) -> None:
    """Compares each kernel under both ways to begin anew."""
    for name in names:
        kernel = kernel_of(name)
        ended = [compare(kernel, steps, how, tolerance) for how in ("same_step", "next_step")]
        print(name, *ended, flush=True)  # noqa: T201  # the test reads it


if __name__ == "__main__":
    if sys.argv[1] == "refuses":
        for how in ("each", "later"):
            for name in sys.argv[2:]:
                refuses(kernel_of(name), how)
        print("refused")  # noqa: T201  # likewise
    else:
        main(sys.argv[3:], int(sys.argv[1]), float(sys.argv[2]))
