"""Compiles kernels to PTX for sm_90, which needs numba-cuda and no device; run in its own process.

Arguments: kernels, as in `cuda_parity`. For each a line: its name, bytes of PTX, fused operations.
"""

import re
import sys
from types import SimpleNamespace

import numba.cuda.codegen
import numba.cuda.dispatcher

from gamekeeper.kernels import cuda_code
from tests.kernels.cuda_parity import kernel_of

CAPABILITY = (9, 0)


def main(names: list[str]) -> None:
    """Compiles as for a device, asking none what it is capable of."""
    device = SimpleNamespace(compute_capability=CAPABILITY)
    numba.cuda.dispatcher.get_current_device = lambda: device
    numba.cuda.codegen.devices.get_context = lambda: SimpleNamespace(device=device)
    numba.cuda.dispatcher._Kernel.bind = lambda kernel: None  # nothing is loaded
    for name in names:
        code = cuda_code.code_of(kernel_of(name))
        size = fused = 0
        for thread in (code.begin, code.judge, code.step):
            (made,) = thread.overloads.values()
            ptx = made._codelibrary.get_asm_str(cc=CAPABILITY)
            assert ".target sm_90" in ptx
            size += len(ptx)
            fused += len(re.findall(r"\bfma\.rn\.f(?:32|64)", ptx))
        print(name, size, fused, flush=True)  # noqa: T201  # the test reads it


if __name__ == "__main__":
    main(sys.argv[1:])
