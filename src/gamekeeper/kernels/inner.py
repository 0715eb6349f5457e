"""Functions that only compiled code calls: they are optimised where they end up, and nowhere else.

Numba optimises each function with all that it calls, so a rule that stands five calls deep would be
optimised five times, and made into machine code that nobody runs. These are kept as they were
written until a driver that is called from Python takes them in. It compiles three times as fast.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from gamekeeper.kernels.rules import OPTIONS, numba, numba_part


def inner(function: Callable[..., Any], **options: Any) -> Any:
    """The function, for compiled code to call; called from Python it is compiled on its own.

    Args:
        function: a rule, or a part of a driver.
        options: of Numba's, besides the rules' own.
    """
    targets = {"nopython": True, "boundscheck": None, **OPTIONS, **options}
    return _dispatcher_class()(function, {}, targets)


@cache
def _dispatcher_class() -> Any:
    """What Numba takes for a compiled function; made where Numba is there."""
    compiler, codegen = numba_part("core.compiler"), numba_part("core.codegen")

    class Unbound:
        """A code generator that binds no environment to code which isn't made into machine code."""

        def __init__(self, own: Any) -> None:
            self._own = own

        def __getattr__(self, name: str) -> Any:
            return getattr(self._own, name)

        def set_env(self, name: str, environment: Any) -> None:
            pass

    class Library(codegen.JITCodeLibrary):  # type: ignore[misc,name-defined]  # Numba's
        """Code that waits to be linked into a driver's."""

        @property
        def codegen(self) -> Any:
            return Unbound(self._codegen)

        def _optimize_functions(self, module: Any) -> None:
            module.data_layout = self._codegen._data_layout

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, name: str) -> int:
            return 0

    class Compiler(compiler.Compiler):  # type: ignore[misc,name-defined]  # Numba's
        """Numba's own steps into such a library."""

        def define_pipelines(self) -> Any:
            state = self.state
            state.library = Library(state.targetctx.codegen(), state.func_id.func_qualname)
            state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = True
            return super().define_pipelines()

    class Inner(numba_part("core.registry").CPUDispatcher):  # type: ignore[misc]  # Numba's
        """A function with such a library; pickled, it is one again."""

        def __init__(self, py_func: Any, local: Any, targetoptions: Any) -> None:
            super().__init__(py_func, local, targetoptions, pipeline_class=Compiler)
            self._own: Any = None

        def __call__(self, *args: Any) -> Any:
            if self._own is None:
                self._own = numba().njit(self.py_func, **OPTIONS)
            return self._own(*args)

    return Inner
