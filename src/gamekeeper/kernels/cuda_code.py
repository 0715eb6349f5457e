"""A kernel's rules compiled for CUDA: one thread plays one copy.

The very drivers that loop over copies on a processor's cores, each copy in a thread of its own. In
Numba's simulator (NUMBA_ENABLE_CUDASIM=1) the same threads run as plain Python.

Floats: products and sums aren't contracted into one operation, so that + - * / and roots have the
bits they have elsewhere; functions as `math.sin` are the device's own, good to a few units in the
last place.
"""

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import ActionError
from gamekeeper.kernels.array_views import copy_of
from gamekeeper.kernels.compile_cache import kernel_key, known
from gamekeeper.kernels.copy_steps import clear_books, driver_of_one
from gamekeeper.kernels.driver import plain_copy
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_arrays import Arrays, mapped
from gamekeeper.kernels.legality import judge_one
from gamekeeper.kernels.own_memory import OwnReader, put_back
from gamekeeper.kernels.rule_parts import Parts
from gamekeeper.kernels.scalar_rules import numba_part

cuda, types = (
    numba_part("cuda"),
    numba_part("core.types"),
)  # `cuda`: the simulator looks for it here
IS_SIMULATED: Final = bool(numba_part("core.config").ENABLE_CUDASIM)
NOBODY: Final = 1 << 62
"""Value of `wrong` as long as all actions are legal."""
_WORD, _FLAG = types.int64, types.boolean
_WORDS: Final = types.Array(types.int64, 1, "C")
BEGIN: Final = (_WORDS, _WORD, _WORD, _WORD, _FLAG)
JUDGE: Final = (_WORDS, _WORD, _WORDS)
STEP: Final = (_WORDS, _WORD, _WORDS, _WORD, _WORD, _WORD, _FLAG, _FLAG)


@dataclass(frozen=True)
class Code:
    """Three CUDA kernels over `count` copies whose arrays stand at `places`.

    Attributes:
        begin: `begin(places, count, pool, constant, tells)`: every copy begins its first episode.
        judge: `judge(places, count, wrong)`: wrong[0] is the first copy with an illegal action.
        step: `step(places, count, wrong, pool, constant, slots, is_next, tells)`: one step of every
            copy; of none as long as wrong[0] names one.
    """

    begin: Any
    judge: Any
    step: Any


def code_of(kernel: Kernel) -> Code:
    """A kernel's compiled code, for the device at hand; the same for kernels that are alike."""
    code: Code = known(f"cuda {kernel_key(kernel)}", lambda: _compiled(kernel))
    return code


def _compiled(kernel: Kernel) -> Code:
    sys.stderr.write(f"gamekeeper: compiles {kernel.name} for CUDA\n")
    parts = Parts(kernel, is_plain=False)
    threads = _threads(parts, copy_of(kernel), copy_of(kernel, OwnReader), put_back(kernel))
    return Code(*map(compiled, threads, (BEGIN, JUDGE, STEP)))


def simulated(kernel: Kernel, records: NDArray[Any], tables: NDArray[Any], arrays: Arrays) -> Code:
    """The same as plain Python in Numba's simulator; `places` mean nothing to it."""
    copy = plain_copy(records, tables, arrays)

    def back(places: Any, e: int, s: Any, a: Any) -> None:
        """The views are of the arrays themselves."""

    threads = _threads(Parts(kernel, is_plain=True), copy, copy, back)
    return Code(*(cuda.jit(thread) for thread in threads))


def _threads(
    parts: Parts, copy: Callable[..., Any], own: Callable[..., Any], back: Callable[..., None]
) -> tuple[Any, Any, Any]:
    """Functions by which the thread of one sub-environment begins, judges and steps.

    Args:
        copy: `copy(places, e)`, views of the arrays.
        own: likewise, of the thread's own memory, which `back(places, e, s, a)` copies back.
    """
    begin_one, step_one = driver_of_one(parts)
    judge_one_, clear = judge_one(parts), clear_books(parts)

    def begin(places: Any, count: Any, pool: Any, constant: Any, tells: Any) -> None:
        e = cuda.grid(1)
        if e < count:
            s, t, a = own(places, e)
            clear(a)
            a.over[()] = False
            a.ended[()] = False
            s.number = e
            begin_one(s, t, a, pool, constant, tells)
            back(places, e, s, a)

    def judge(places: Any, count: Any, wrong: Any) -> None:
        e = cuda.grid(1)
        if e < count:
            _, _, a = copy(places, e)
            if not judge_one_(a, a.over[()]):
                cuda.atomic.min(wrong, 0, e)  # threads come in any order; the first copy is named

    def step(
        places: Any,
        count: Any,
        wrong: Any,
        pool: Any,
        constant: Any,
        slots: Any,
        is_next: Any,
        tells: Any,
    ) -> None:
        e = cuda.grid(1)
        if e < count and wrong[0] == NOBODY:
            s, t, a = own(places, e)
            end = step_one(s, t, a, a.over[()], pool, constant, slots, is_next, tells)
            a.ended[()] = end != 0
            a.over[()] = end > 1
            back(places, e, s, a)

    return begin, judge, step


def compiled(thread: Callable[..., None], kinds: tuple[Any, ...]) -> Any:
    """A function of one thread as a CUDA kernel, compiled for arguments of these types."""
    with _uncontracted():
        return cuda.jit(types.void(*kinds), lto=False)(thread)


@contextmanager
def _uncontracted() -> Iterator[None]:
    """Keeps `a * b + c` from being fused in what compiles meanwhile; Numba has no option.

    Link-time optimisation would fuse them after all, so it is off.
    """
    dispatcher = numba_part("cuda.dispatcher")
    original = dispatcher.compile_cuda

    def compile_cuda(*arguments: Any, nvvm_options: Any = None, **options: Any) -> Any:
        return original(*arguments, nvvm_options={**(nvvm_options or {}), "fma": False}, **options)

    dispatcher.compile_cuda = compile_cuda
    try:
        yield
    finally:
        dispatcher.compile_cuda = original


CUDA_DEVICE: Final = 2
"""Number of a CUDA device in DLPack."""

if not IS_SIMULATED:
    _Base: Any = numba_part("cuda.cudadrv.devicearray").DeviceNDArray

    class DeviceArray(_Base):  # type: ignore[misc]  # Numba ships no types
        """An array on the device that torch, JAX and CuPy take without a copy.

        By DLPack (`torch.from_dlpack(array)`), or by the CUDA array interface
        (`torch.as_tensor(array, device="cuda")`).
        """

        def __dlpack__(self, *, stream: int | None = None, **options: Any) -> Any:
            """Its memory, which it keeps."""
            view = import_module("cuda.core.utils").StridedMemoryView.from_cuda_array_interface(
                self, stream_ptr=-1
            )
            return view.__dlpack__(stream=stream, **options)

        def __dlpack_device__(self) -> tuple[int, int]:
            """The device it is on."""
            return CUDA_DEVICE, cuda.get_current_device().id


class Memory:
    """Memory on the device for arrays on the host; in the simulator it is the host's."""

    def __init__(self) -> None:
        self._held: dict[int, tuple[NDArray[np.uint8], Any]] = {}

    def counterpart(self, array: NDArray[Any]) -> Any:
        """Copy of an array on the device; views of one array share memory."""
        if IS_SIMULATED:
            return array
        if not array.nbytes:
            return DeviceArray(array.shape, array.strides, array.dtype)
        held = self._held.get(array.ctypes.data)
        if held is None:
            flat = array.reshape(-1).view(np.uint8)
            held = self._held[array.ctypes.data] = flat, cuda.to_device(flat)
        data = held[1].gpu_data
        return DeviceArray(array.shape, array.strides, array.dtype, gpu_data=data)

    def counterparts(self, value: Any) -> Any:
        """The counterparts of the arrays in a tuple of arrays and such tuples."""
        return mapped(value, self.counterpart)

    def pull(self, *arrays: NDArray[Any]) -> None:
        """Copies from the device into these arrays on the host; into all where none is named."""
        names = [array.ctypes.data for array in arrays] or list(self._held)
        for name in names:
            if name in self._held:
                flat, there = self._held[name]
                there.copy_to_host(flat)

    def push(self, array: NDArray[Any]) -> None:
        """Copies an array of the host to the device."""
        if array.ctypes.data in self._held:
            flat, there = self._held[array.ctypes.data]
            there.copy_to_device(flat)


def address(array: Any) -> int:
    """Address of an array on the device."""
    if IS_SIMULATED:
        return int(array.ctypes.data)
    return int(array.device_ctypes_pointer.value or 0)


def put(place: Any, given: Any) -> None:
    """Copies an array, of the host or of the device, over one on the device.

    Raises:
        ActionError: shapes differ; on the device, types too.
    """
    if IS_SIMULATED:
        place[...] = given
        return
    facts = getattr(given, "__cuda_array_interface__", None)
    if facts is None:
        given = np.ascontiguousarray(given, place.dtype)
        shape, dtype = given.shape, given.dtype
    else:
        shape, dtype = facts["shape"], np.dtype(facts["typestr"])
    if shape != place.shape or dtype != place.dtype:
        raise ActionError(
            "the actions don't fit all sub-environments",
            where="step(actions)",
            expected=f"{place.dtype} {place.shape}",
            actual=f"{dtype} {shape}",
            fix="hand in an array of this type and shape, an action for each sub-environment",
        )
    if facts is None:
        place.copy_to_device(given)
    elif facts.get("strides") is not None:
        place.copy_to_device(cuda.as_cuda_array(given))
    else:  # Numba's own copy takes 0.2 to 0.6 ms to look at both
        driver = import_module("cuda.bindings.driver")
        driver.cuMemcpyDtoDAsync(address(place), facts["data"][0], place.nbytes, 0)


def graph_of(*launches: Callable[[Any], None]) -> Callable[[], None]:
    """A function that starts all of these on the default stream, one after the other, at once.

    A launch of Numba's takes some 40 us of Python, that of a graph some 5, however many it holds.

    Args:
        launches: each launches a CUDA kernel on the stream that it is given.
    """
    if IS_SIMULATED:

        def launch_all() -> None:
            for launch in launches:
                launch(0)

        return launch_all
    core = import_module("cuda.core")
    device = core.Device(cuda.get_current_device().id)
    device.set_current()
    building = device.create_graph_builder()
    building.begin_building()
    with quiet():
        for launch in launches:
            launch(building)
    graph, stream = building.end_building().complete(), core.Stream.from_handle(0)
    return lambda: graph.launch(stream)


@contextmanager
def quiet() -> Iterator[None]:
    """Silences Numba's advice on small grids: how many copies there are is the user's choice."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Grid size")
        yield
