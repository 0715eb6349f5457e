"""Import guard: code that a run names never finds modules in the current folder or in the run's.

While a guard is active, the import system looks at what is installed and at absolute entries of
`sys.path` elsewhere. Entries that are empty, relative, or equal to or inside a closed folder are
gone, in this process and in the workers that it starts, and one that foreign code adds later is
passed over. Folders are compared as the file system knows them, so that neither a link nor another
spelling is a way around.
"""

from __future__ import annotations

import hashlib
import os
import site
import sys
import sysconfig
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final

FolderId = tuple[int, int]
"""Device and inode: equal for all names of one folder."""
INIT: Final = "__init__.py"
_ONE_AT_A_TIME: Final = threading.RLock()
"""The import path belongs to the whole process: a second thread waits for the first one's guard."""


class ImportGuard(PathFinder):
    """Finds modules in place of Python's own `PathFinder`."""

    def __init__(
        self, closed: Iterable[str], modules: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        """Prepares a guard; `guarded` makes it active.

        Args:
            closed: folders in which nothing is found.
            modules: files and digests of modules, by name, that are found in closed folders as long
                as the file has the digest.
        """
        self.modules = dict(modules or {})
        roots = (root for root in _roots(self.modules) if root not in pythonpath())
        self.closed = tuple(dict.fromkeys([*closed, *roots]))
        outer = active()
        self.path_before: list[str] = list(sys.path) if outer is None else outer.path_before
        self._packages = {name.partition(".")[0] for name in self.modules}
        self._closed = _ids(self.closed)
        self._relative = _ids(entry for entry in pythonpath() if not Path(entry).is_absolute())
        self._sites = _ids(site_folders())
        self._listed = _ids(line for folder in site_folders() for line in _pth_lines(folder))
        self._allowed: dict[str, bool] = {}

    def allows(self, entry: object) -> bool:
        """Tells if an entry of the import path may stay."""
        if not isinstance(entry, str) or not Path(entry).is_absolute():
            return False
        if entry not in self._allowed:
            itself = _ids([entry])
            whole = itself | _ids(map(str, Path(os.path.realpath(entry)).parents))
            is_installed = bool(self._sites & whole or self._listed & itself)
            is_loose = bool(self._closed & whole or self._relative & itself)
            self._allowed[entry] = is_installed or not is_loose
        return self._allowed[entry]

    def find_spec(  # type: ignore[override]  # a class has it as a method of the class
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """A module's spec as `PathFinder` finds it, from the entries that may stay."""
        if fullname.partition(".")[0] in self._packages:
            return self._known(fullname)
        return PathFinder.find_spec(fullname, self.path() if path is None else path, target)

    def path(self) -> list[str]:
        """The entries of `sys.path` that may stay."""
        return [entry for entry in sys.path if self.allows(entry)]

    def _known(self, name: str) -> ModuleSpec | None:
        if name not in self.modules:
            return None
        file, digest = self.modules[name]
        if file.endswith(".py"):
            return spec_from_file_location(name, file, loader=UnchangedSource(name, file, digest))
        if Path(file).is_dir():  # a namespace package
            spec = ModuleSpec(name, None, is_package=True)
            spec.submodule_search_locations = [file]
            return spec
        _check(name, Path(file).read_bytes(), digest)
        return spec_from_file_location(name, file)

    def to_json(self) -> dict[str, Any]:
        """Plain data, from which `install` makes the same guard in a worker."""
        return {"closed": list(self.closed), "modules": self.modules}


class UnchangedSource(SourceFileLoader):
    """Runs the very bytes of a source file that have the digest, never a cached bytecode."""

    def __init__(self, fullname: str, path: str, digest: str) -> None:
        """Stores the digest that the file must have."""
        super().__init__(fullname, path)
        self._digest = digest

    def get_code(self, fullname: str) -> CodeType:
        """The code of the file.

        Raises:
            ImportError: the file has another digest.
        """
        source = self.get_data(self.path)
        _check(fullname, source, self._digest)
        return self.source_to_code(source, self.path)


@contextmanager
def guarded(
    *folders: str | os.PathLike[str],
    modules: Mapping[str, Sequence[str]] | None = None,
    is_here_closed: bool = True,
) -> Iterator[ImportGuard]:
    """Closes folders to imports until the block ends; see `ImportGuard`.

    Args:
        folders: closed beside what an outer guard closes.
        modules: files and digests of modules that are found all the same.
        is_here_closed: close the current folder too; False: open it, also where an outer guard
            closes it.
    """
    outer, here = active(), list[str]()
    with suppress(FileNotFoundError):  # deleted: nothing can be found there
        here.append(str(Path.cwd()))
    beyond = [each for each in (outer.closed if outer else ()) if each not in here]
    closed = [*(str(Path(each).absolute()) for each in folders), *beyond]
    closed += here if is_here_closed else []
    guard = ImportGuard(closed, modules)
    with _changed(guard, guard.path()):
        yield guard


@contextmanager
def unguarded() -> Iterator[None]:
    """Lifts all guards until the block ends: the user has consented."""
    guard = active()
    with _changed(PathFinder, sys.path if guard is None else guard.path_before):
        yield


def install(guard: ImportGuard | None) -> None:
    """Makes a guard the active one of this process from now on; None: removes it."""
    outer = active()
    if guard is not None:
        sys.path[:] = guard.path()
    elif outer is not None:
        sys.path[:] = outer.path_before
    _put(PathFinder if guard is None else guard)


def active() -> ImportGuard | None:
    """The guard that finds modules in this process now."""
    return next((finder for finder in sys.meta_path if isinstance(finder, ImportGuard)), None)


def worker_environment(variables: Mapping[str, str]) -> dict[str, str]:
    """Environment variables of a worker: under a guard, Python's own start obeys it too."""
    guard = active()
    if guard is None:
        return dict(variables)
    allowed = [entry for entry in pythonpath(variables) if guard.allows(entry)]
    rest = {name: value for name, value in variables.items() if name != "PYTHONPATH"}
    found = {"PYTHONPATH": os.pathsep.join(allowed)} if allowed else {}
    return {**rest, **found, "PYTHONSAFEPATH": "1"}  # for processes that the worker starts


def pythonpath(variables: Mapping[str, str] | None = None) -> list[str]:
    """The entries of PYTHONPATH; an empty one stands for the current folder."""
    text = (os.environ if variables is None else variables).get("PYTHONPATH", "")
    return text.split(os.pathsep) if text and not sys.flags.ignore_environment else []


def site_folders() -> set[str]:
    """Folders of the standard library and of installed packages."""
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    sites = {sysconfig.get_path(name) for name in names} | set(site.getsitepackages())
    return sites | ({site.getusersitepackages()} if site.ENABLE_USER_SITE else set())


def digest_of(data: bytes) -> str:
    """The digest of a module's file."""
    return hashlib.blake2b(data, digest_size=32).hexdigest()


def _check(name: str, data: bytes, digest: str) -> None:
    if digest_of(data) != digest:
        raise ImportError(
            f"the file of {name} isn't the one that the run was recorded with; if you trust what "
            "it is now, say --allow-import (allow_import=True)"
        )


def _pth_lines(folder: str) -> Iterator[str]:
    """Folders that the `.pth` files of a site folder add. Source: docs.python.org, `site`."""
    for file in sorted(Path(folder).glob("*.pth")):
        try:
            lines = file.read_text(encoding="utf-8-sig", errors="replace").splitlines()
        except OSError:
            continue
        for line in map(str.strip, lines):
            if line and not line.startswith(("#", "import ", "import\t")):
                yield str(Path(folder) / line)


def _ids(folders: Iterable[str]) -> set[FolderId]:
    """Device and inode of the folders that exist, which are the same under every name."""
    found = set()
    for folder in folders:
        try:
            seen = Path(folder).stat()
        except (OSError, ValueError):
            continue
        found.add((seen.st_dev, seen.st_ino))
    return found


def _roots(modules: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Folders from which modules were imported."""
    for name, (file, _) in modules.items():
        depth = name.count(".") + (Path(file).name == INIT)
        yield str(Path(file).parents[min(depth, len(Path(file).parents) - 1)])


def _put(finder: Any) -> None:
    """Puts `PathFinder` or a guard where the other one stands."""
    for place, there in enumerate(sys.meta_path):
        if there is PathFinder or isinstance(there, ImportGuard):
            sys.meta_path[place] = finder
            return
    sys.meta_path.append(finder)


@contextmanager
def _changed(finder: Any, path: Sequence[str]) -> Iterator[None]:
    """Changes finder and import path until the block ends; entries added meanwhile stay."""
    with _ONE_AT_A_TIME:
        path_outer, path_inner, outer = list(sys.path), list(path), active()
        sys.path[:] = path_inner
        _put(finder)
        try:
            yield
        finally:
            known = {*path_outer, *path_inner}
            sys.path[:] = [*path_outer, *(entry for entry in sys.path if entry not in known)]
            _put(PathFinder if outer is None else outer)
