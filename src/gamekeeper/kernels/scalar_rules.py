"""`rule`: a scalar function that runs as plain Python, or compiled where Numba is installed.

The very same function is both. Compiled, it is Numba's; `as_python` gives its plain
counterpart, with every rule that it calls, for breakpoints and for comparison.
"""

import sys
import types
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, Final

import numpy as np

OPTIONS: Final = {"error_model": "numpy", "fastmath": False, "nogil": True}
"""As C divides, no reordering of sums (the bits would depend on the compiler), threads run free."""


@cache
def numba() -> Any:
    """Numba, or None where it isn't installed, which is said once."""
    try:
        import numba as found
    except ImportError:
        sys.stderr.write(
            "gamekeeper: kernels run as plain Python, some hundred times slower than compiled; "
            "pip install 'gamekeeper[fast]' brings Numba\n"
        )
        return None
    return found


def numba_part(name: str) -> Any:
    """A module of Numba's, which has types here and there."""
    return import_module(f"numba.{name}")


def rule(function: Callable[..., Any]) -> Any:
    """Makes a rule of a function: compiled at its first call, or itself without Numba.

    A rule works on numbers, on records and on arrays of fixed shape; it may call other rules, and
    functions of `math`. What it takes from outside (constants, tables) is frozen when it compiles.
    """
    if numba() is None:
        return function
    return inner(function)


def inlined(function: Callable[..., Any]) -> Any:
    """A rule that is taken in wherever it is called: a small one that others call in loops.

    A call that isn't taken in costs as much as some ten operations, and hides from the compiler
    what is the same before and after it.
    """
    if numba() is None:
        return function
    return inner(function, forceinline=True)


class Plain(np.ndarray[Any, Any]):
    """An array whose elements come out as Python numbers, as wide as compiled arithmetic is.

    A bare `np.int16` would overflow where 64 bits don't, a bare `np.bool_` refuses a minus.
    Those of an array of records come out as `Copy`s.
    """

    def __getitem__(self, key: Any) -> Any:
        value = super().__getitem__(key)
        if isinstance(value, np.void):
            bare = np.asarray(self)
            return Copy(bare if key == () else bare[key : key + 1].reshape(()))
        return value.item() if isinstance(value, np.generic) else value


class Copy:
    """A record as plain Python sees it: attributes are Python numbers and arrays of them.

    Writing goes through to the record's memory, so the bytes are those that compiled rules see.
    """

    __slots__ = ("__dict__", "_record")

    def __init__(self, record: Any) -> None:
        """Looks at a record, an array of one element with no dimensions."""
        object.__setattr__(self, "_record", record)
        for name in record.dtype.names or ():
            if record[name].ndim:
                object.__setattr__(self, name, record[name].view(Plain))

    def __getattr__(self, name: str) -> Any:
        try:
            return self._record[name].item()
        except ValueError:
            raise AttributeError(f"the state has no field {name!r}") from None

    def __setattr__(self, name: str, value: Any) -> None:
        self._record[name] = value


def as_python(function: Any, known: dict[Any, Any] | None = None) -> Any:
    """A rule as plain Python: the same code object, so that breakpoints by file and line work."""
    known = {} if known is None else known
    plain = getattr(function, "py_func", function)
    if plain in known:
        return known[plain]
    names = dict(plain.__globals__)
    cells = tuple(types.CellType() for _ in plain.__closure__ or ())
    counterpart = types.FunctionType(
        plain.__code__, names, plain.__name__, plain.__defaults__, cells or None
    )
    known[plain] = counterpart
    for cell, old in zip(cells, plain.__closure__ or (), strict=True):
        cell.cell_contents = _plain_value(old.cell_contents, known)
    for name in plain.__code__.co_names:
        if name in names:
            names[name] = _plain_value(names[name], known)
    return counterpart


def _plain_value(value: Any, known: dict[Any, Any]) -> Any:
    if hasattr(value, "py_func"):
        return as_python(value, known)
    if isinstance(value, types.ModuleType):
        return _PlainModule(value, known)
    return value.view(Plain) if type(value) is np.ndarray else value


class _PlainModule:
    """A module whose rules come out as their plain counterparts."""

    def __init__(self, module: types.ModuleType, known: dict[Any, Any]) -> None:
        self._module, self._known = module, known

    def __getattr__(self, name: str) -> Any:
        return _plain_value(getattr(self._module, name), self._known)


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
    """Class that Numba takes for a compiled function; made where Numba is there."""
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
