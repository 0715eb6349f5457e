"""Arrays on a CUDA device, each the twin of one on the host, for whoever computes there."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import ActionError
from gamekeeper.kernels.cuda_code import IS_SIMULATED, cuda
from gamekeeper.kernels.rules import numba_part

CUDA_DEVICE: Final = 2
"""What DLPack calls one."""

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

    def twin(self, array: NDArray[Any]) -> Any:
        """The array's twin on the device, with what it holds; views of one array share memory."""
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

    def twins(self, value: Any) -> Any:
        """The twins of the arrays in a tuple of arrays and such tuples."""
        if not isinstance(value, tuple):
            return self.twin(value)
        parts = [self.twins(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)

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
    """Where an array on the device stands."""
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
    is_there = hasattr(given, "__cuda_array_interface__")
    found = cuda.as_cuda_array(given) if is_there else np.ascontiguousarray(given, place.dtype)
    if found.shape != place.shape or found.dtype != place.dtype:
        raise ActionError(
            "these aren't actions of all copies",
            where="step(actions)",
            expected=f"{place.dtype} {place.shape}",
            seen=f"{found.dtype} {found.shape}",
        )
    place.copy_to_device(found)
