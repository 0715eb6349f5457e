"""Compiled code on disk, found again by what it was compiled from."""

from __future__ import annotations

import sys
from typing import Any

from gamekeeper.kernels.rules import OPTIONS, key_of, numba


def compiled(function: Any, name: str) -> Any:
    """The function, compiled at its first call or read from disk; which of the two it says.

    Numba's own key is a pickle of the closure, which holds other dispatchers and so never matches.
    The code lies beside ours, or in the user's cache folder where that can't be written to
    (`NUMBA_CACHE_DIR` names another one); where nothing can be written, it is compiled each time.

    Args:
        function: a driver over rules.
        name: of the kernel, for who waits.
    """
    from numba.core.caching import FunctionCache

    key = key_of(function)
    dispatcher = numba().njit(function, **OPTIONS)

    class StableCache(FunctionCache):  # type: ignore[misc]  # numba has no types
        def _index_key(self, signature: Any, codegen: Any) -> Any:
            return (signature, codegen.magic_tuple(), (key, key))

        def load_overload(self, *arguments: Any) -> Any:
            found = super().load_overload(*arguments)
            if found is None:
                sys.stderr.write(f"gamekeeper: compiles {name}, once; it is kept on disk\n")
            return found

    try:
        dispatcher._cache = StableCache(dispatcher.py_func)
    except RuntimeError:  # no place for a cache
        sys.stderr.write(
            f"gamekeeper: compiles {name}, and can't keep it: no cache folder can be written to; "
            "NUMBA_CACHE_DIR=folder names one\n"
        )
    return dispatcher
