"""Kernels: the rules of an environment written once as scalar functions over one copy's state.

`from gamekeeper.kernels import Kernel, draws, inlined, rule` is all that an author needs.
"""

from __future__ import annotations

from gamekeeper.kernels import draws
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.rules import inlined, rule

__all__ = ["Kernel", "draws", "inlined", "rule"]
