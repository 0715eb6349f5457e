"""Kernels: the rules of an environment written once as scalar functions over one copy's state.

`from gamekeeper.kernels import Kernel, draws, inlined, rule` is all that an author needs.
`kernel_env` gives one copy as PettingZoo has it, `Batch` many in arrays.
"""

from gamekeeper.kernels import draws
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import kernel_env
from gamekeeper.kernels.scalar_rules import inlined, rule

__all__ = ["Batch", "Kernel", "draws", "inlined", "kernel_env", "rule"]
