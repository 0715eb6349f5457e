"""A thread's own memory of one copy on a CUDA device, for as long as it plays a step.

The arrays of a batch are [copy, ...], as on a processor: threads that go through them side by side
touch as many lines of memory as there are threads, for every number. A device lays out a thread's
own memory so that the same number of all threads stands in one line, or keeps it in registers. So
what a step reads and writes again and again is copied there, as words of up to 16 bytes, and back.
"""

from math import gcd
from typing import Any, Final

from gamekeeper.kernels.array_views import AddressReader, leaves, sample_of, view_type_of
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_arrays import Arrays
from gamekeeper.kernels.scalar_rules import numba_part

OWNED: Final = frozenset(
    ("obs", "masks", "rewards", "terms", "terminated", "truncated", "live", "turn", "over", "ended")
)
"""Arrays that every step writes; those of endings and infos it rarely does."""
LARGEST: Final = 2048
"""Bytes of one copy's row beyond which a state or an array stays where it is, as pictures do."""
WORD: Final = 16
"""Bytes that a thread moves at once, at most."""


def is_owned(name: str, whole: Any) -> bool:
    """Tells if one copy of this array is in a thread's own memory."""
    return name in OWNED and 0 < sum(part.strides[0] for part in leaves(whole)) <= LARGEST


def has_one_term(sample: Arrays) -> bool:
    """Tells if terms are the rewards' own memory."""
    return bool(sample.terms.ctypes.data == sample.rewards.ctypes.data)


class OwnReader(AddressReader):
    """Makes views of a thread's own memory, filled from the arrays."""

    def state(self, size: int) -> Any:
        """The state's address, in own memory unless it is long."""
        self.record = self.filled(size) if size <= LARGEST else self.pointer(size)
        return self.record

    def filled(self, size: int) -> Any:
        """Own memory with the bytes of the next address."""
        byte = numba_part("core.cgutils").int8_t
        # LLVM turns only what is reserved in the entry block into registers; elsewhere it would
        # also take new stack at every pass of a loop.
        with self.builder.goto_entry_block():
            own = self.builder.alloca(byte, size)
        own.align = WORD
        move(self.builder, self.pointer(size), own, size)
        return own

    def arrays(self, sample: Arrays) -> Any:
        """Views of all arrays; raw bytes are the state's, a single term is the reward."""
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
        if not whole.strides[0]:
            return self.view(whole)
        return self.view_at(whole, self.filled(whole.strides[0]))


def put_back(kernel: Kernel) -> Any:
    """`put_back(places, e, s, a)`, compiled: copies own memory to the arrays of copy e."""
    types, intrinsic = numba_part("core.types"), numba_part("extending").intrinsic
    sample = sample_of(kernel)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        places, index, record, arrays = values
        reads = AddressReader(context, builder, signature.args[0], places, index)
        size = kernel.dtype.itemsize
        if size <= LARGEST:
            move(builder, record, reads.pointer(size), size)
        reads.count = 2  # the state and the tables

        def part_back(whole: Any, value: Any, is_mine: bool) -> None:
            if isinstance(whole, tuple):
                for number, part in enumerate(whole):
                    part_back(part, builder.extract_value(value, number), is_mine)
            elif is_mine and whole.strides[0]:
                own = reads.arrayobj.make_array(view_type_of(whole))(context, builder, value).data
                move(builder, own, reads.pointer(whole.strides[0]), whole.strides[0])
            else:  # it stayed where it was: its address is passed over
                reads.count += 1

        for number, (name, whole) in enumerate(zip(sample._fields, sample, strict=True)):
            is_mine = is_owned(name, whole) and not (name == "terms" and has_one_term(sample))
            part_back(whole, builder.extract_value(arrays, number), is_mine)
        return context.get_dummy_value()

    @intrinsic  # type: ignore[untyped-decorator]  # Numba's
    def back(typing_context: Any, places: Any, index: Any, s: Any, a: Any) -> Any:
        """Copies one copy's own memory back."""
        return types.void(types.Array(types.int64, 1, "C"), types.intp, s, a), generate

    return back


def move(builder: Any, source: Any, target: Any, size: int) -> None:
    """Writes the code that copies so many bytes, as words that both addresses are aligned to."""
    ir = numba_part("core.cgutils").ir
    # Row e lies e * size behind an aligned address: its alignment is what divides both.
    width = gcd(size, WORD)
    word = ir.VectorType(ir.IntType(64), 2) if width == WORD else ir.IntType(8 * width)
    pointers = [builder.bitcast(place, word.as_pointer()) for place in (source, target)]
    for number in range(size // width):
        at = [ir.Constant(ir.IntType(64), number)]
        loaded = builder.load(builder.gep(pointers[0], at, inbounds=True))
        loaded.align = width
        stored = builder.store(loaded, builder.gep(pointers[1], at, inbounds=True))
        stored.align = width
