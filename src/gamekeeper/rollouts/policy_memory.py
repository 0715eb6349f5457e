"""Memory of policies: whatever they hold, and what functions keep in their modules."""

import io
import pickle
import random
import sys
from collections.abc import Iterable, Iterator
from functools import partial
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any, Final

import numpy as np

MOST_BYTES: Final = 1 << 24
"""Bytes of memory that are compared after each continuation."""
_PLAIN: Final = (str, bytes, int, float, complex, bool, type(None), np.ndarray, np.generic)
_CODE: Final = (FunctionType, MethodType, partial, staticmethod, classmethod)
_GENERATORS: Final = (np.random.Generator, np.random.RandomState, random.Random)


class _Pickler(pickle.Pickler):
    """Pickles by value, but for generators: their states aren't what a policy remembers."""

    def persistent_id(self, obj: Any) -> str | None:
        return "generator" if isinstance(obj, _GENERATORS) else None


def state_of(things: Iterable[Any]) -> bytes | None:
    """State of objects, to be compared with `==`; None where it can't be read, or is too large."""
    file = io.BytesIO()
    try:
        _Pickler(file, protocol=pickle.HIGHEST_PROTOCOL).dump(list(things))
    except Exception:  # foreign code refuses in many ways
        return None
    return file.getvalue() if file.tell() <= MOST_BYTES else None


def own_state(policies: Iterable[Any]) -> bytes | None:
    """State of what the policies hold themselves, as `state_of` gives it."""
    return state_of(vars(each) for each in policies if hasattr(each, "__dict__"))


def shared_state(policies: Iterable[Any]) -> bytes | None:
    """State of what copies of the policies share with them, as `state_of` gives it.

    That is what their functions refer to: variables of modules, closures, defaults, and attributes
    of functions and classes.
    """
    found: list[Any] = []
    seen: set[int] = set()
    waiting: list[Any] = list(policies)
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        for value in _referred(item):
            if isinstance(value, _CODE):
                waiting.append(value)
            elif not isinstance(value, ModuleType | type | BuiltinFunctionType | property):
                found.append(value)
                if not isinstance(value, _PLAIN):
                    waiting.append(value)
    return state_of(found)


def _referred(item: Any) -> Iterator[Any]:
    """Values that an object's functions refer to."""
    if isinstance(item, partial):
        yield item.func
    elif isinstance(item, MethodType):
        yield from (item.__self__, item.__func__)
    elif isinstance(item, staticmethod | classmethod):
        yield item.__func__
    elif isinstance(item, FunctionType):
        if not _is_library(item.__module__, item.__code__.co_filename):
            yield from _read_by(item)
    else:
        for kind in type(item).__mro__:
            if not _is_library(kind.__module__):
                own = vars(kind).items()
                yield from (
                    each for name, each in own if not name.startswith("__") or callable(each)
                )


def _is_library(module: Any, file: str = "") -> bool:
    """Tells whether it stands in an installed library or Python's own, taken to keep no memory."""
    first = str(module).partition(".")[0]
    if not file:
        file = str(getattr(sys.modules.get(str(module)), "__file__", "") or "")
    return first in sys.stdlib_module_names or "site-packages" in file


def _read_by(function: FunctionType) -> Iterator[Any]:
    """Values of the names that a function reads, and what it keeps by itself."""
    yield from vars(function).values()
    yield from function.__defaults__ or ()
    for cell in function.__closure__ or ():
        try:
            yield cell.cell_contents
        except ValueError:  # it is still empty
            continue
    codes: list[CodeType] = [function.__code__]
    for code in codes:
        codes += [each for each in code.co_consts if isinstance(each, CodeType)]
    names = {name for code in codes for name in code.co_names}
    yield from (function.__globals__[name] for name in names if name in function.__globals__)
