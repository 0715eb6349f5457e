"""`row(arrays, e)`: one copy's part of an array, or of a tuple of arrays, borrowed.

A slice of an array costs two atomic reference counts when it is compiled, which is half of the time
that a cheap rule takes; a borrowed view has none. It must not outlive the call it is made for.
"""

from __future__ import annotations

from typing import Any

from gamekeeper.kernels.rules import Plain, numba, numba_part


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
    if isinstance(array, tuple):
        parts = [plain_row(part, index) for part in array]
        return type(array)(*parts) if hasattr(array, "_fields") else tuple(parts)
    return array[index : index + 1].reshape(array.shape[1:]).view(Plain)


row = plain_row if numba() is None else _compiled()
