"""A thread's own memory of one copy on a CUDA device, for as long as it plays a step.

The arrays of a batch are [copy, ...], as on a processor. A thread that reads and writes its copy's
row there number by number keeps a line of memory busy for each, and its 31 neighbours likewise. So
the threads of a warp bring the rows of their copies together, side by side, as one run of words:
the states into memory that they share, where each plays on its own row; what they show is made in
registers, and goes back the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import gcd
from typing import Any, Final

from gamekeeper.kernels.array_views import AddressReader, copy_of, leaves, sample_of, view_type_of
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_arrays import Arrays
from gamekeeper.kernels.scalar_rules import numba_part

WARP: Final = 32
"""Threads that run in step, and copies that they play; a block is one warp."""
WORD: Final = 8
"""Bytes that a thread moves at once."""
OWNED: Final = frozenset(
    ("obs", "masks", "rewards", "terms", "terminated", "truncated", "live", "turn", "over", "ended")
)
"""Arrays that every step writes. Those of endings and infos are rarely written, actions read once."""
LARGEST: Final = 48 * 1024 // WARP - WORD
"""Bytes of a row that 32 threads can share, of 48 KiB; longer ones stay where they are."""
SMALLEST: Final = 16
"""Bytes of a row beyond which threads bring it together; shorter ones lie in few lines anyway."""

SHARED: Final = "rows"
"""Name of the shared memory in compiled code."""


def is_owned(name: str, whole: Any) -> bool:
    """Whether one copy of this array is in a thread's own memory."""
    return name in OWNED and all(part.strides[0] <= LARGEST for part in leaves(whole))


def is_joined(size: int) -> bool:
    """Whether the threads of a warp move rows of so many bytes together."""
    return SMALLEST < size <= LARGEST and size % WORD == 0


def has_one_term(sample: Arrays) -> bool:
    """Whether terms are the rewards' own memory."""
    return bool(sample.terms.ctypes.data == sample.rewards.ctypes.data)


class OwnReader(AddressReader):
    """Makes views of a thread's own memory, filled from the arrays.

    All threads of a warp call it, those without a copy too: these read the last copy's row.
    """

    def __init__(
        self,
        context: Any,
        builder: Any,
        kind: Any,
        places: Any,
        index: Any,
        count: Any,
        *,
        longest: int,
    ) -> None:
        last = builder.sub(count, index.type(1))
        here = builder.select(builder.icmp_signed("<", index, count), index, last)
        super().__init__(context, builder, kind, places, here)
        self.warp = Warp(builder, index, count, longest)

    def state(self, size: int) -> Any:
        """The state's address in own memory."""
        if is_joined(size):
            self.record = self.warp.row(size)
            self.warp.together(self.first_of(size), size, self.warp.bring)
            self.warp.wait()
        else:
            self.record = self.filled(size)
        return self.record

    def first_of(self, size: int) -> Any:
        """The next address, moved on to the first copy of this warp."""
        here, self.index = self.index, self.warp.first
        try:
            return self.pointer(size)
        finally:
            self.index = here

    def filled(self, size: int) -> Any:
        """Registers, or memory of the thread's alone, with the bytes of the next address."""
        byte = numba_part("core.cgutils").int8_t
        with self.builder.goto_entry_block():
            own = self.builder.alloca(byte, size)
        own.align = WORD
        move(self.builder, self.pointer(size), own, size)  # what is written before it is read goes
        return own

    def arrays(self, sample: Arrays) -> Any:
        """One copy's views of all arrays; the state's bytes and a single term are shared memory."""
        found: dict[str, Any] = {}
        for name, whole in zip(sample._fields, sample, strict=True):
            if name == "raw":
                self.count += 1
                found[name] = self.view_at(whole, self.record)
            elif name == "terms" and has_one_term(sample):
                self.count += 1
                rewards = self.arrayobj.make_array(view_type_of(sample.rewards))
                data = rewards(self.context, self.builder, found["rewards"]).data
                found[name] = self.view_at(whole, data)
            else:
                found[name] = self.own_view(whole) if is_owned(name, whole) else self.view(whole)
        return self.context.make_tuple(self.builder, view_type_of(sample), list(found.values()))

    def own_view(self, whole: Any) -> Any:
        """Views of own memory of an array of one copy, or of a tuple of such."""
        if isinstance(whole, tuple):
            parts = [self.own_view(part) for part in whole]
            return self.context.make_tuple(self.builder, view_type_of(whole), parts)
        size = whole.strides[0]
        return self.view_at(whole, self.filled(size)) if size else self.view(whole)


def own_of(kernel: Kernel) -> Any:
    """`own(places, e, count)`, compiled: state, tables and views as of `copy_of`, in own memory."""
    return copy_of(kernel, partial(OwnReader, longest=longest_of(kernel)))


def longest_of(kernel: Kernel) -> int:
    """Bytes of the longest row that the threads of a warp move together; 0 where there is none."""
    sample = sample_of(kernel)
    shown = [part for name in OWNED for part in leaves(getattr(sample, name))]
    sizes = [kernel.dtype.itemsize, *(part.strides[0] for part in shown)]
    return max((size for size in sizes if is_joined(size)), default=0)


def put_back(kernel: Kernel) -> Any:
    """`put_back(places, e, count, s, a)`, compiled: copies own memory to the arrays of copy e.

    All threads of a warp call it, as they do what filled it.
    """
    types, intrinsic = numba_part("core.types"), numba_part("extending").intrinsic
    sample, size, longest = sample_of(kernel), kernel.dtype.itemsize, longest_of(kernel)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        places, index, count, record, arrays = values
        kind = signature.args[0]
        reads = OwnReader(context, builder, kind, places, index, count, longest=longest)
        warp, is_there = reads.warp, builder.icmp_signed("<", index, count)
        warp.wait()
        row_back(reads, record, size, is_there, is_shared=is_joined(size))
        reads.count += 1  # the tables
        for value, whole, is_mine in _owned(builder, arrays, sample):
            if is_mine and whole.strides[0]:
                own = reads.arrayobj.make_array(view_type_of(whole))(context, builder, value).data
                row_back(reads, own, whole.strides[0], is_there, is_shared=False)
            else:
                reads.count += 1
        return context.get_dummy_value()

    @intrinsic  # type: ignore[untyped-decorator]  # Numba's
    def put(typing_context: Any, places: Any, index: Any, count: Any, s: Any, a: Any) -> Any:
        """Copies one copy's own memory back."""
        words = types.Array(types.int64, 1, "C")
        return types.void(words, types.intp, types.intp, s, a), generate

    return put


def row_back(reads: OwnReader, own: Any, size: int, is_there: Any, *, is_shared: bool) -> None:
    """Writes the code that copies a row back to the next address."""
    warp, builder = reads.warp, reads.builder
    if not is_joined(size):
        target = reads.pointer(size)
        with builder.if_then(is_there):
            move(builder, own, target, size)
        return
    if not is_shared:
        move(builder, own, warp.row(size), size)
        warp.wait()
    warp.together(reads.first_of(size), size, warp.send)
    warp.wait()


def _owned(builder: Any, value: Any, sample: Arrays) -> Iterator[tuple[Any, Any, bool]]:
    """Each array's value, its sample, and whether it is to be copied back."""

    def parts(value: Any, whole: Any, is_mine: bool) -> Iterator[tuple[Any, Any, bool]]:
        if not isinstance(whole, tuple):
            yield value, whole, is_mine
            return
        for number, part in enumerate(whole):
            yield from parts(builder.extract_value(value, number), part, is_mine)

    for number, (name, whole) in enumerate(zip(sample._fields, sample, strict=True)):
        is_twice = name == "terms" and has_one_term(sample)
        part = builder.extract_value(value, number)
        yield from parts(part, whole, is_owned(name, whole) and not is_twice)


class Warp:
    """Writes the code by which 32 threads move the rows of their copies, word beside word."""

    def __init__(self, builder: Any, index: Any, count: Any, longest: int) -> None:
        self.longest = longest // WORD | 1
        self.builder, self.ir = builder, numba_part("core.cgutils").ir
        self.lane = builder.and_(index, index.type(WARP - 1))
        self.first = builder.sub(index, self.lane)
        left = builder.sub(count, self.first)
        full = index.type(WARP)
        self.rows = builder.select(builder.icmp_signed("<", left, full), left, full)

    def together(self, first: Any, size: int, one: Callable[[Any, Any], None]) -> None:
        """Moves all rows of so many bytes; `first` is the address of the first."""
        builder, words, kind = self.builder, size // WORD, self.lane.type
        there = builder.bitcast(first, kind.as_pointer())
        last = builder.sub(builder.mul(self.rows, kind(words)), kind(1))
        for number in range(words):
            at = builder.add(self.lane, kind(number * WARP))
            at = builder.select(builder.icmp_signed("<", at, last), at, last)  # the last one again
            row, column = at, kind(0)
            place = at
            if words % 2 == 0:  # rows are of odd length, or threads would meet in one bank
                row, column = builder.udiv(at, kind(words)), builder.urem(at, kind(words))
                place = builder.add(builder.mul(row, kind(words + 1)), column)
            one(builder.gep(there, [at]), builder.gep(self.shared(), [place]))

    def bring(self, there: Any, here: Any) -> None:
        """Copies a word into shared memory."""
        self.builder.store(self.builder.load(there), here)

    def send(self, there: Any, here: Any) -> None:
        """Copies a word out of shared memory."""
        self.builder.store(self.builder.load(here), there)

    def row(self, size: int) -> Any:
        """This thread's row in shared memory."""
        kind = self.lane.type
        start = self.builder.mul(self.lane, kind(size // WORD | 1))
        row = self.builder.gep(self.shared(), [start])
        return self.builder.bitcast(row, numba_part("core.cgutils").int8_t.as_pointer())

    def shared(self) -> Any:
        """Memory that the warp shares: for the states, and once these are back, for other rows."""
        cgutils, nvvm = numba_part("core.cgutils"), numba_part("cuda.cudadrv.nvvm")
        ir, module, word = self.ir, self.builder.module, self.lane.type
        found = module.globals.get(SHARED)
        if found is None:
            whole = ir.ArrayType(word, WARP * self.longest)
            found = cgutils.add_global_variable(module, whole, SHARED, nvvm.ADDRSPACE_SHARED)
            found.linkage, found.align = "internal", WORD
            found.initializer = ir.Constant(whole, ir.Undefined)
        pointer = self.builder.bitcast(found, ir.PointerType(word, nvvm.ADDRSPACE_SHARED))
        return self.builder.addrspacecast(pointer, ir.PointerType(word), "generic")

    def wait(self) -> None:
        """Waits for the other threads of the warp, and for what they wrote."""
        ir, cgutils = self.ir, numba_part("core.cgutils")
        kind = ir.FunctionType(ir.VoidType(), (ir.IntType(32),))
        sync = cgutils.get_or_insert_function(self.builder.module, kind, "llvm.nvvm.bar.warp.sync")
        self.builder.call(sync, [ir.Constant(ir.IntType(32), -1)])


def move(builder: Any, source: Any, target: Any, size: int) -> None:
    """Writes the code that copies so many bytes, as words that both addresses are aligned to."""
    ir = numba_part("core.cgutils").ir
    width = gcd(size, WORD)
    word = ir.IntType(8 * width)
    pointers = [builder.bitcast(place, word.as_pointer()) for place in (source, target)]
    for number in range(size // width):
        at = [ir.Constant(ir.IntType(64), number)]
        loaded = builder.load(builder.gep(pointers[0], at, inbounds=True))
        loaded.align = width
        stored = builder.store(loaded, builder.gep(pointers[1], at, inbounds=True))
        stored.align = width
