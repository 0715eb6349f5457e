"""Addresses of the arrays of a batch, which compiled drivers take.

Shapes are known when a driver compiles, so that a driver needs one argument for all arrays, and its
code has their strides as constants. That makes small batches twice as fast, and cheap rules too.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_arrays import Arrays, arrays_of, mapped
from gamekeeper.kernels.scalar_rules import Plain, numba, numba_part


def tables_of(kernel: Kernel) -> NDArray[Any]:
    """The kernel's tables as an array of one record; of a kernel without any, an empty record's."""
    if kernel.tables is None:
        return np.zeros(1, np.dtype([("nothing", "i1")]))
    tables: NDArray[Any] = kernel.tables.reshape(1)
    return tables


def places_of(records: NDArray[Any], tables: NDArray[Any], arrays: Arrays) -> NDArray[np.int64]:
    """Addresses of the records, of the tables, and of every array in its order.

    They hold as long as these arrays are kept.

    Raises:
        SpecError: an array isn't one block of memory.
    """
    found = [records, tables, *leaves(arrays)]
    for array in found:
        if not array.flags.c_contiguous or not array.flags.aligned:
            raise SpecError(
                "an array of a batch isn't one block of memory",
                where="make",
                expected="C order, aligned",
                actual=f"strides {array.strides}, shape {array.shape}",
                fix="hand in numpy.ascontiguousarray(array)",
            )
    return np.array([array.ctypes.data for array in found], np.int64)


def leaves(value: Any) -> Iterator[NDArray[Any]]:
    """The arrays in a tuple of arrays and such tuples, in order."""
    if isinstance(value, tuple):
        for part in value:
            yield from leaves(part)
    else:
        yield value


def shapes(kernel: Kernel) -> str:
    """Shapes and types of the arrays: part of the key under which compiled code is kept."""
    sample = sample_of(kernel)
    parts = [f"{array.dtype.descr}{array.shape}" for array in leaves(sample)]
    names = [type(part).__name__ for part in sample if isinstance(part, tuple)]
    return repr((kernel.dtype.descr, tables_of(kernel).dtype.descr, parts, names))


def copy_of(kernel: Kernel, reader: type[AddressReader] | None = None) -> Any:
    """`copy(places, e)`, compiled: the state of copy e, the tables, and its views of the arrays.

    The views are borrowed: no reference is counted, and none may outlive the call.

    Args:
        reader: makes the views; None: views of the arrays themselves.
    """
    types, intrinsic = numba_part("core.types"), numba_part("extending").intrinsic
    kind_of_reader, sample = reader or AddressReader, sample_of(kernel)
    kinds = [numba().from_dtype(dtype) for dtype in (kernel.dtype, tables_of(kernel).dtype)]
    found = types.Tuple((*kinds, view_type_of(sample)))

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        reads = kind_of_reader(context, builder, signature.args[0], *values)
        pointers = reads.state(kernel.dtype.itemsize), reads.pointer(0)
        records = [
            builder.bitcast(pointer, context.get_value_type(kind))
            for pointer, kind in zip(pointers, kinds, strict=True)
        ]
        return context.make_tuple(builder, found, [*records, reads.arrays(sample)])

    @intrinsic  # type: ignore[untyped-decorator]  # Numba's
    def copy(typing_context: Any, places: Any, index: Any) -> Any:
        """The state, the tables and the views of one copy."""
        return found(types.Array(types.int64, 1, "C"), types.intp), generate

    return copy


def sample_of(kernel: Kernel) -> Arrays:
    """The arrays of one copy, for their shapes and types."""
    return arrays_of(kernel, np.zeros(1, kernel.dtype))


def view_type_of(whole: Any) -> Any:
    """The compiled type of one copy's views of an array of one copy, or of a tuple of such."""
    types = numba_part("core.types")
    if isinstance(whole, tuple):
        parts = tuple(view_type_of(part) for part in whole)
        return types.BaseTuple.from_types(parts, type(whole) if hasattr(whole, "_fields") else None)
    return types.Array(numba().from_dtype(whole.dtype), whole.ndim - 1, "C")


class AddressReader:
    """Reads address after address, and writes the code that makes views of them."""

    def __init__(self, context: Any, builder: Any, kind: Any, places: Any, index: Any) -> None:
        self.arrayobj = numba_part("np.arrayobj")
        self.context, self.builder, self.index = context, builder, index
        self.base = self.arrayobj.make_array(kind)(context, builder, places).data
        self.count = 0

    def number(self, n: int) -> Any:
        """A constant."""
        return self.context.get_constant(numba().intp, n)

    def pointer(self, size: int) -> Any:
        """The next address, moved on by as many times `size` bytes as the copy's number."""
        builder, byte = self.builder, self.context.get_value_type(numba().int8)
        start = builder.load(builder.gep(self.base, [self.number(self.count)]))
        # Addresses stay while a driver runs: LLVM may load them once, before its loop.
        start.set_metadata("invariant.load", builder.module.add_metadata([]))
        self.count += 1
        offset = builder.mul(self.index, self.number(size))
        return builder.gep(builder.inttoptr(start, byte.as_pointer()), [offset], inbounds=True)

    def state(self, size: int) -> Any:
        """The state's address."""
        return self.pointer(size)

    def arrays(self, sample: Arrays) -> Any:
        """One copy's views of all arrays."""
        return self.view(sample)

    def view(self, whole: Any) -> Any:
        """One copy's views of an array of one copy, or of a tuple of such."""
        if isinstance(whole, tuple):
            kind = view_type_of(whole)
            return self.context.make_tuple(self.builder, kind, [self.view(part) for part in whole])
        return self.view_at(whole, self.pointer(whole.strides[0]))

    def view_at(self, whole: Any, pointer: Any) -> Any:
        """A view of one copy's part of an array at this address."""
        array = self.arrayobj.make_array(view_type_of(whole))(self.context, self.builder)
        self.arrayobj.populate_array(
            array,
            data=self.builder.bitcast(pointer, array.data.type),
            shape=[self.number(n) for n in whole.shape[1:]],
            strides=[self.number(n) for n in whole.strides[1:]],
            itemsize=self.number(whole.itemsize),
            meminfo=None,
            parent=None,
        )
        return array._getvalue()


def _compiled() -> Any:
    cgutils, types = numba_part("core.cgutils"), numba_part("core.types")
    arrayobj, intrinsic = numba_part("np.arrayobj"), numba_part("extending").intrinsic

    def view_type(whole: Any) -> Any:
        if isinstance(whole, types.BaseTuple):
            parts = tuple(view_type(part) for part in whole)
            return types.BaseTuple.from_types(parts, getattr(whole, "instance_class", None))
        layout = "C" if whole.layout == "C" else "A"
        return types.Array(whole.dtype, whole.ndim - 1, layout, aligned=whole.aligned)

    def view(context: Any, builder: Any, kinds: tuple[Any, Any], value: Any, index: Any) -> Any:
        kind, view_kind = kinds
        if isinstance(kind, types.BaseTuple):
            parts = [
                view(context, builder, pair, part, index)
                for pair, part in zip(
                    zip(kind, view_kind, strict=True),
                    cgutils.unpack_tuple(builder, value),
                    strict=True,
                )
            ]
            return context.make_tuple(builder, view_kind, parts)
        whole = arrayobj.make_array(kind)(context, builder, value)
        shape = cgutils.unpack_tuple(builder, whole.shape)
        strides = cgutils.unpack_tuple(builder, whole.strides)
        offset = builder.mul(strides[0], index)
        part = arrayobj.make_array(view_kind)(context, builder)
        arrayobj.populate_array(
            part,
            data=cgutils.pointer_add(builder, whole.data, offset, whole.data.type),
            shape=shape[1:],
            strides=strides[1:],
            itemsize=whole.itemsize,
            meminfo=None,
            parent=None,
        )
        return part._getvalue()

    @intrinsic  # type: ignore[untyped-decorator]  # Numba's
    def row(typing_context: Any, array: Any, index: Any) -> Any:
        """The borrowed view `array[index]`, or a tuple of such views."""
        if not isinstance(array, types.Array | types.BaseTuple):
            return None
        if not isinstance(index, types.Integer):
            return None
        found = view_type(array)

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return view(context, builder, (array, found), *values)

        return found(array, types.intp), generate

    return row


def plain_row(array: Any, index: int) -> Any:
    """The same for plain Python: views whose elements are Python numbers."""
    return mapped(array, lambda part: part[index : index + 1].reshape(part.shape[1:]).view(Plain))


row = plain_row if numba() is None else _compiled()
