"""pyarrow without pandas until somebody wants it, in processes that are ours.

Where pandas is installed pyarrow imports it with the first value that it converts, which takes from
0.3 to 3 seconds in each process of a command and is of no use to us. Here it makes its first
conversion while pandas can't be found, and is told to look again as soon as somebody imports it: an
environment that hands a Series to pyarrow can't tell the difference.
"""

import importlib.util
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

Path = Sequence[str] | None


class _Absent(MetaPathFinder):
    """Says that a module isn't installed, as long as it stands in front of the others."""

    def __init__(self, name: str) -> None:
        self._name = name

    def find_spec(self, name: str, path: Path, target: ModuleType | None = None) -> None:
        if name == self._name:
            raise ModuleNotFoundError(f"no module {name!r} for now", name=name)


class _After(MetaPathFinder):
    """Calls something once a module has been imported, however that comes about."""

    def __init__(self, name: str, call: Callable[[], None]) -> None:
        self._name, self._call = name, call

    def find_spec(
        self, name: str, path: Path, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != self._name:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is None or spec.loader is None:
            return spec
        run, call = spec.loader.exec_module, self._call

        def exec_module(module: ModuleType) -> None:
            run(module)
            call()

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]  # of this one loader
        return spec


def pandas_can_wait() -> None:
    """From now on pyarrow imports pandas only after somebody else has; for our own processes."""
    if "pyarrow" not in sys.modules and "pandas" not in sys.modules:
        sys.meta_path.insert(0, _After("pyarrow", _start_alone))


def _start_alone() -> None:
    import pyarrow as pa

    known = getattr(pa.lib, "_pandas_api", None)
    if "pandas" in sys.modules or not hasattr(type(known), "version"):
        return  # another pyarrow, which couldn't be told afterwards
    absent = _Absent("pandas")
    sys.meta_path.insert(0, absent)
    try:
        pa.array([0])  # looks for pandas, once
    finally:
        sys.meta_path.remove(absent)
    sys.meta_path.insert(0, _After("pandas", lambda: _look_again(known)))


def _look_again(known: object) -> None:
    _ = known.version  # type: ignore[attr-defined]  # asking for it looks once more
