"""`row(array, e)`: one copy's part of an array, borrowed.

A slice of an array costs two atomic reference counts when it is compiled, which is half of the time
that a cheap rule takes; a borrowed view has none. It must not outlive the call it is made for.
"""

from __future__ import annotations

from typing import Any

from gamekeeper.kernels.rules import numba


def _compiled() -> Any:
    from numba.core import cgutils, types
    from numba.extending import intrinsic
    from numba.np import arrayobj

    @intrinsic  # type: ignore[untyped-decorator]  # Numba ships no types
    def row(typing_context: Any, array: Any, index: Any) -> Any:
        """The borrowed view `array[index]`."""
        if not isinstance(array, types.Array) or not isinstance(index, types.Integer):
            return None
        layout = "C" if array.layout == "C" else "A"
        view = types.Array(array.dtype, array.ndim - 1, layout, aligned=array.aligned)

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            whole = arrayobj.make_array(signature.args[0])(context, builder, values[0])
            shape = cgutils.unpack_tuple(builder, whole.shape)
            strides = cgutils.unpack_tuple(builder, whole.strides)
            offset = builder.mul(strides[0], values[1])
            part = arrayobj.make_array(signature.return_type)(context, builder)
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

        return view(array, types.intp), generate

    return row


def _plain(array: Any, index: int) -> Any:
    return array[index]


row = _plain if numba() is None else _compiled()
