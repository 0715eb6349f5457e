"""Compiled code on disk, found again by what it was compiled from.

Numba's own cache goes by the text of one file and by a pickle of the closure; neither says what a
driver over somebody's rules is made of, so here one key does. It lies in `NUMBA_CACHE_DIR` where
that is set, else beside this package, else in the user's cache folder: read from any of them, and
written to the first that can be written to, where what was read longest ago makes room.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from gamekeeper.kernels.rules import OPTIONS, numba, numba_part
from gamekeeper.waiting import Wait

BROKEN = (EOFError, pickle.UnpicklingError, AttributeError, ImportError, ValueError, TypeError)
"""What reading a file back can say that is no such code, or of another version."""
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
    """What was made under that key in this process, so that a second batch compiles nothing."""
    made = _made()
    if key not in made:
        made[key] = make()
    return made[key]


@cache
def _made() -> dict[str, Any]:
    return {}


def folders() -> Iterator[Path]:
    """Where compiled code may lie, first where it is written."""
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

    class Store(numba_part("core.caching").NullCache):  # type: ignore[misc]  # Numba's
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
            )  # fmt: skip

    return Store


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
