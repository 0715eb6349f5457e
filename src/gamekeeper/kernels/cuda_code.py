"""A kernel's rules compiled for CUDA: one thread plays one copy.

The very drivers that loop over copies on a processor's cores, each copy in a thread of its own. In
Numba's simulator (NUMBA_ENABLE_CUDASIM=1) the same threads run as plain Python.

Floats: products and sums aren't contracted into one operation, so that + - * / and roots have the
bits they have elsewhere; functions as `math.sin` are the device's own, good to a few units in the
last place.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from numpy.typing import NDArray

from gamekeeper.kernels.arrays import Arrays
from gamekeeper.kernels.drivers import copies
from gamekeeper.kernels.judge import judge_one
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.keys import kernel_key
from gamekeeper.kernels.parts import Parts
from gamekeeper.kernels.places import copy_of
from gamekeeper.kernels.rows import plain_row
from gamekeeper.kernels.rules import numba_part
from gamekeeper.kernels.ticks import clear_books, tick_driver
from gamekeeper.kernels.turns import turn_driver

cuda, types = (
    numba_part("cuda"),
    numba_part("core.types"),
)  # `cuda`: the simulator looks for it here
IS_SIMULATED: Final = bool(numba_part("core.config").ENABLE_CUDASIM)
NOBODY: Final = 1 << 62
"""What stands in `wrong` as long as all actions are legal."""
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
    key = kernel_key(kernel)
    known = _known()
    if key not in known:
        sys.stderr.write(f"gamekeeper: compiles {kernel.name} for CUDA\n")
        parts = Parts(kernel, is_plain=False)
        kinds = (BEGIN, JUDGE, STEP)
        loops = zip(_threads(parts, copy_of(kernel)), kinds, strict=True)
        known[key] = Code(*(compiled(loop, kind) for loop, kind in loops))
    return known[key]


def simulated(kernel: Kernel, records: NDArray[Any], tables: NDArray[Any], arrays: Arrays) -> Code:
    """The same as plain Python in Numba's simulator; `places` mean nothing to it."""
    t, states = copies(tables)[0], copies(records)
    rows = [plain_row(arrays, e) for e in range(len(records))]

    def copy(places: Any, e: int) -> Any:
        return states[e], t, rows[e]

    threads = _threads(Parts(kernel, is_plain=True), copy)
    return Code(*(cuda.jit(thread) for thread in threads))


@cache
def _known() -> dict[str, Code]:
    return {}


def _threads(parts: Parts, copy: Callable[..., Any]) -> tuple[Any, Any, Any]:
    """What the thread of one copy does to begin, to judge and to step."""
    begin_one, step_one = turn_driver(parts) if parts.kernel.api == "aec" else tick_driver(parts)
    judge_one_, clear = judge_one(parts), clear_books(parts)

    def begin(places: Any, count: Any, pool: Any, constant: Any, tells: Any) -> None:
        e = cuda.grid(1)
        if e < count:
            s, t, a = copy(places, e)
            clear(a)
            a.over[()] = False
            a.ended[()] = False
            s.number = e
            begin_one(s, t, a, pool, constant, tells)

    def judge(places: Any, count: Any, wrong: Any) -> None:
        e = cuda.grid(1)
        if e < count:
            _, _, a = copy(places, e)
            if not judge_one_(a, a.over[()]):
                cuda.atomic.min(wrong, 0, e)

    def step(
        places: Any, count: Any, wrong: Any,
        pool: Any, constant: Any, slots: Any, is_next: Any, tells: Any,
    ) -> None:  # fmt: skip
        e = cuda.grid(1)
        if e < count and wrong[0] == NOBODY:
            s, t, a = copy(places, e)
            end = step_one(s, t, a, a.over[()], pool, constant, slots, is_next, tells)
            a.ended[()] = end != 0
            a.over[()] = end > 1

    return begin, judge, step


def compiled(thread: Callable[..., None], kinds: tuple[Any, ...]) -> Any:
    """A function of one thread as a CUDA kernel, compiled for arguments of these types."""
    with _uncontracted():
        return cuda.jit(types.void(*kinds), lto=False)(thread)


@contextmanager
def _uncontracted() -> Iterator[None]:
    """What compiles meanwhile has no fused `a * b + c`, for which Numba has no option.

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
