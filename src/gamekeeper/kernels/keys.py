"""What compiled code hangs on, as a digest: equal in every process, another after any change."""

from __future__ import annotations

import hashlib
import types
from functools import cache
from importlib import resources
from typing import Any, Final

import numpy as np

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.places import shapes

SIZE: Final = 16
RULES: Final = ("reset", "step", "act", "observe", "mask", "inform", "overview")


def kernel_key(kernel: Kernel) -> str:
    """Names what a driver of this kernel is made of: rules, shapes, actions, numbers.

    Values of tables aren't in it: they are read as the rules run. Nor are bounds of observations,
    which no driver looks at: their shapes are all that it knows.
    """
    digest = hashlib.blake2b(digest_size=SIZE)
    for name in RULES:
        digest.update(f"{name} {key_of(getattr(kernel, name))}".encode())
    spaces = [str(group.action_space) for group in kernel.groups]
    numbers = kernel.limit > 0, kernel.plays_illegal, len(kernel.terms), kernel.tables is None
    digest.update(repr((shapes(kernel), spaces, numbers)).encode())
    return digest.hexdigest()


def code_key(function: Any, kernel: Kernel) -> str:
    """Names what a driver's function compiles to: its code with all that it calls, and shapes."""
    told = key_of(function), shapes(kernel), views_source()
    return hashlib.blake2b(repr(told).encode(), digest_size=SIZE).hexdigest()


@cache
def views_source() -> bytes:
    """The text of what writes the code of views, which no function's own code shows."""
    files = resources.files("gamekeeper.kernels")
    return b"".join(files.joinpath(name).read_bytes() for name in ("places.py", "rows.py"))


def key_of(function: Any) -> str:
    """What a rule compiles to hangs on this: its code, its constants, all that it calls."""
    digest = hashlib.blake2b(digest_size=SIZE)
    _feed(digest, function, (), set())
    return digest.hexdigest()


def _feed(digest: Any, value: Any, names: tuple[str, ...], seen: set[Any]) -> None:
    """Feeds a value; of a module the `names` that the code around it has."""
    plain = getattr(value, "py_func", value)
    if isinstance(plain, types.FunctionType):
        if plain not in seen:
            seen.add(plain)
            _feed_function(digest, plain, seen)
    elif isinstance(plain, types.ModuleType):
        digest.update(plain.__name__.encode())
        if plain.__name__.partition(".")[0] not in ("numpy", "math", "numba"):
            for name in names:
                _feed(digest, getattr(plain, name, None), names, seen)
    elif isinstance(plain, np.ndarray):
        digest.update(f"{plain.dtype.descr} {plain.shape}".encode() + plain.tobytes())
    elif isinstance(plain, tuple | list):
        digest.update(f"{type(plain).__name__} {len(plain)}".encode())
        for part in plain:
            _feed(digest, part, names, seen)
    elif isinstance(plain, int | float | complex | str | bytes | np.generic | type(None)):
        digest.update(f"{type(plain).__name__} {plain!r}".encode())
    else:
        digest.update(_name_of(plain).encode())


def _feed_function(digest: Any, function: types.FunctionType, seen: set[Any]) -> None:
    codes = list(_codes(function.__code__))
    names = tuple(sorted({name for code in codes for name in code.co_names}))
    for code in codes:
        digest.update(code.co_code + repr((code.co_names, code.co_varnames)).encode())
        for constant in code.co_consts:
            if not isinstance(constant, types.CodeType):
                _feed(digest, constant, (), seen)
    for cell in function.__closure__ or ():
        _feed(digest, cell.cell_contents, names, seen)
    _feed(digest, function.__defaults__, names, seen)
    for name in names:
        if name in function.__globals__:
            _feed(digest, function.__globals__[name], names, seen)


def _codes(code: types.CodeType) -> Any:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _name_of(value: Any) -> str:
    """A class, a builtin, a NumPy function: what it is called, which no address is part of."""
    kind = type(value)
    name = getattr(value, "__qualname__", getattr(value, "__name__", kind.__qualname__))
    return f"{getattr(value, '__module__', kind.__module__)}.{name}"
