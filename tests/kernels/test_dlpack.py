"""A batch's arrays are those of whoever learns from them: nothing is copied."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.kernels.array_views import leaves
from gamekeeper.kernels.batch import Batch
from tests.kernels.lines import WINDY
from tests.kernels.turned import STICKS

ENVS = 4


@pytest.mark.parametrize("kernel", [WINDY, STICKS])
def test_arrays_are_handed_over_without_a_copy(kernel: Any) -> None:
    """Every array of numbers, at the address where the next step writes."""
    batch = Batch(kernel, ENVS, debug=True)
    batch.reset()
    for array in leaves(batch.arrays):
        if array.size and not array.dtype.names:
            taken = np.from_dlpack(array)
            assert np.shares_memory(taken, array)
            assert (taken.shape, taken.dtype) == (array.shape, array.dtype)


def test_arrays_show_every_step() -> None:
    """Taken once, they show what each later step wrote."""
    batch = Batch(WINDY, ENVS, debug=True)
    seen = np.from_dlpack(batch.reset())
    rng, before, changed = np.random.default_rng(0), seen.copy(), 0
    for _ in range(20):
        obs, *_ = batch.step(rng.integers(0, 3, (ENVS, 2)))
        assert obs is batch.arrays.obs
        assert np.array_equal(seen, obs)
        changed += int(not np.array_equal(seen, before))
        before = seen.copy()
    assert changed > 10


def test_arrays_are_torchs() -> None:
    """Torch reads every step, and writes the next actions, in the batch's own memory."""
    torch = pytest.importorskip("torch")
    batch = Batch(WINDY, ENVS, debug=True)
    batch.reset()
    arrays = batch.arrays
    seen, actions = torch.from_dlpack(arrays.obs), torch.from_dlpack(arrays.actions)
    live, rewards = torch.from_dlpack(arrays.live), torch.from_dlpack(arrays.rewards)
    assert seen.data_ptr() == arrays.obs.ctypes.data
    assert (live.dtype, rewards.dtype) == (torch.bool, torch.float64)
    actions.fill_(1)
    batch.step()
    assert np.array_equal(np.ones((ENVS, 2)), arrays.actions)
    assert torch.equal(seen, torch.from_numpy(arrays.obs.copy()))
