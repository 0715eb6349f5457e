"""Digest of all that compiled code depends on, and the compiled code on disk."""

import hashlib
import os
import pickle
import sys
import tempfile
import types
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from gamekeeper.heartbeat import Wait
from gamekeeper.kernels.array_views import shapes
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import OPTIONS, numba, numba_part

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
    parts = key_of(function), shapes(kernel), views_source()
    return hashlib.blake2b(repr(parts).encode(), digest_size=SIZE).hexdigest()


@cache
def views_source() -> bytes:
    """The text of what writes the code of views, which no function's own code shows."""
    return resources.files("gamekeeper.kernels").joinpath("array_views.py").read_bytes()


def key_of(function: Any) -> str:
    """Key of a rule's compiled code: its source, its constants, all that it calls."""
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


BROKEN = (EOFError, pickle.UnpicklingError, AttributeError, ImportError, ValueError, TypeError)
"""Errors of reading a file that holds no such code, or code of another version."""
SUFFIX: Final = ".kernel"
MOST_FILES: Final = 1_000
"""In a folder; one takes about 100 kB, a kernel's batch some 10 of them."""


def compiled(function: Any, name: str, key: str) -> Any:
    """The function, compiled at its first call or read from disk; which of the two it says.

    Where nothing can be written, it is compiled in each process.

    Args:
        function: a driver over rules.
        name: of the kernel, for who waits.
        key: of its code, and of what that has from elsewhere.
    """
    dispatcher = numba().njit(function, **OPTIONS)
    dispatcher._cache = _store_class()(name, f"{name}-{function.__name__}", key)
    return dispatcher


def known(key: str, make: Callable[[], Any]) -> Any:
    """Returns the object made under that key in this process: a second batch compiles nothing."""
    made = _made()
    if key not in made:
        made[key] = make()
    return made[key]


@cache
def _made() -> dict[str, Any]:
    return {}


def folders() -> Iterator[Path]:
    """Folders of compiled code, the one to write to first."""
    config, dirs = numba_part("core.config"), numba_part("misc.appdirs")
    if config.CACHE_DIR:
        yield Path(config.CACHE_DIR)
    else:
        yield Path(__file__).with_name("__pycache__")
    yield Path(dirs.AppDirs(appname="gamekeeper", appauthor=False).user_cache_dir)


@cache
def _say(name: str, what: str) -> None:
    """One line for each kernel's name, whatever the number of its functions and sizes."""
    sys.stderr.write(f"gamekeeper: {what.format(name=name)}\n")


@cache
def _store_class() -> Any:
    """The class of what a dispatcher asks; made where Numba is there."""
    results, dumps = numba_part("core.compiler").CompileResult, numba_part("core.serialize").dumps

    class CompiledStore(numba_part("core.caching").NullCache):  # type: ignore[misc]  # Numba's
        """The compiled forms of one function."""

        def __init__(self, name: str, title: str, key: str) -> None:
            self.name, self.title, self.key = name, title, key
            self.waits: list[Wait] = []

        def file_of(self, signature: Any, codegen: Any) -> str:
            """A file's name, by all that the code hangs on."""
            target = str(signature), codegen.magic_tuple(), numba().__version__, sys.version
            digest = hashlib.blake2b(repr((self.key, target)).encode(), digest_size=16).hexdigest()
            return f"{self.title}-{digest}{SUFFIX}"

        def load_overload(self, signature: Any, target: Any) -> Any:
            numba_part("core.runtime").rtsys.initialize(target)  # all that machine code needs
            file = self.file_of(signature, target.codegen())
            for folder in folders():
                try:
                    parts = pickle.loads((folder / file).read_bytes())
                    result = results._rebuild(target, *parts)
                except (OSError, *BROKEN):
                    continue
                with suppress(OSError):  # somebody else's folder: then its age says nothing
                    os.utime(folder / file)
                return result
            _say(self.name, "compiles {name}, once; it is kept on disk")
            self.waits.append(Wait())
            return None

        def save_overload(self, signature: Any, result: Any) -> None:
            while self.waits:
                self.waits.pop().end()
            data = dumps(result._reduce())
            file = self.file_of(signature, result.library.codegen)
            for folder in folders():
                try:
                    _write(folder / file, data)
                    make_room(folder)
                    return
                except OSError:
                    continue
            _say(
                self.name,
                "can't keep {name} compiled: no cache folder can be written to; "
                "NUMBA_CACHE_DIR=folder names one",
            )

    return CompiledStore


def make_room(folder: Path, most: int = MOST_FILES) -> None:
    """Removes compiled code above so many files, what was used longest ago first."""
    used: list[tuple[float, Path]] = []
    for file in folder.glob(f"*{SUFFIX}"):
        with suppress(OSError):  # another process made room
            used.append((file.stat().st_mtime, file))
    for _, file in sorted(used)[: max(0, len(used) - most)]:
        with suppress(OSError):
            file.unlink()


def _write(file: Path, data: bytes) -> None:
    """Writes a file that is there whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=file.name)
    try:
        with os.fdopen(handle, "wb") as whole:
            whole.write(data)
        Path(name).replace(file)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise
