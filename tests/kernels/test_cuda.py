"""Kernels on CUDA: the same bits as plain Python, in Numba's simulator; PTX without a device."""

import os
import subprocess
import sys
from importlib import resources
from importlib.util import find_spec
from pathlib import Path

import pytest

from gamekeeper.errors import DependencyError, SpecError
from gamekeeper.kernels.cuda import CudaBatch
from gamekeeper.kernels.scalar_rules import numba
from tests.kernels.lines import WINDY

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WINDY_LINE, STICKS = "tests.kernels.lines:WINDY", "tests.kernels.turned:STICKS"
TASKS = sorted(
    file.name.removesuffix(".toml")
    for file in resources.files("gamekeeper.tasks").iterdir()
    if file.name.endswith(".toml")
)
BODIES = ("reference", "speaker_listener", "spread", "tag")
"""Tasks whose rules call functions that each device has its own of."""

needs_numba = pytest.mark.skipif(numba() is None, reason="Numba, the extra `fast`, isn't there")
needs_compiler = pytest.mark.skipif(
    find_spec("numba_cuda") is None, reason="numba-cuda, the extra `cuda`, isn't there"
)


def run(script: str, *arguments: str, simulated: bool) -> str:
    """What a script of this folder prints; each has a process, as Numba simulates or doesn't."""
    paths = [str(ROOT), str(ROOT / "src")]
    done = subprocess.run(
        [sys.executable, str(HERE / script), *arguments],
        env={
            **os.environ,
            "NUMBA_ENABLE_CUDASIM": str(int(simulated)),
            "PYTHONPATH": os.pathsep.join(paths),
        },
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2_000:]
    return done.stdout


@needs_numba
def test_cuda_batch_has_the_bits_of_plain_python() -> None:
    """Every array and the state after every step, in ticks and turns, under both autoresets."""
    told = run("cuda_parity.py", "40", "0", WINDY_LINE, STICKS, simulated=True)
    for line in told.splitlines():
        _, same, later = line.split()
        assert min(int(same), int(later)) > 3  # episodes ended, or there was nothing to see


@needs_numba
def test_cuda_batch_plays_tasks_as_plain_python_does() -> None:
    """The same of our own tasks."""
    told = run("cuda_parity.py", "4", "0", *TASKS, simulated=True)
    assert len(TASKS) == len(told.splitlines())


@needs_numba
def test_cuda_batch_refuses_illegal_actions() -> None:
    """At once or at the next check; nothing has changed, and the batch goes on."""
    told = run("cuda_parity.py", "refuses", STICKS, "two_robot_line", simulated=True)
    assert told.strip() == "refused"


@needs_numba
def test_cuda_batch_says_that_there_is_no_device() -> None:
    """Without a device, and without the simulator."""
    from numba import cuda

    if cuda.is_available():
        pytest.skip("there is a device")
    with pytest.raises(DependencyError, match="no CUDA device"):
        CudaBatch(WINDY, 2)


@pytest.mark.parametrize("wrong", [{"autoreset": "never"}, {"checks": "sometimes"}])
def test_cuda_batch_refuses_unknown_options(wrong: dict[str, str]) -> None:
    """By name, before a device is asked for."""
    with pytest.raises(SpecError, match="a batch has no such"):
        CudaBatch(WINDY, 2, **wrong)


@needs_compiler
@pytest.mark.parametrize("name", [WINDY_LINE, STICKS, *TASKS])
def test_kernel_compiles_for_a_device_that_is_not_there(name: str) -> None:
    """To PTX of sm_90; products and sums apart, but in functions that the device brings."""
    _, size, fused = run("cuda_ptx.py", name, simulated=False).split()
    assert int(size) > 10_000
    assert (int(fused) > 0) == (name in BODIES)


@pytest.mark.gpu
@needs_compiler
def test_cuda_batch_has_the_bits_of_plain_python_on_a_device() -> None:
    """Rules of + - * / and roots alone: bit for bit."""
    exact = [name for name in TASKS if name not in BODIES]
    run("cuda_parity.py", "100", "0", WINDY_LINE, STICKS, *exact, simulated=False)


@pytest.mark.gpu
@needs_compiler
def test_cuda_batch_stays_within_tolerance_on_a_device() -> None:
    """Rules that call the device's own functions: a relative 1e-9 over an episode of 25 ticks."""
    run("cuda_parity.py", "25", "1e-9", *BODIES, simulated=False)


@pytest.mark.gpu
@needs_compiler
def test_cuda_arrays_are_torchs_without_a_copy() -> None:
    """What a step writes, torch sees; what torch writes, the next step reads."""
    torch = pytest.importorskip("torch")
    batch = CudaBatch(WINDY, 4)
    batch.reset()
    seen = torch.from_dlpack(batch.arrays.obs)
    actions = torch.from_dlpack(batch.arrays.actions)
    actions.fill_(2)
    before = seen.clone()
    batch.step()
    assert seen.is_cuda
    assert not torch.equal(seen, before)
    assert torch.equal(seen.cpu(), torch.from_numpy(batch.host().obs))
