"""`path/to/file.py:factory`: a Python file that no package holds."""

import functools
from os import PathLike, fspath
from pathlib import Path
from typing import Final

from gamekeeper.interface.construction import find_factory
from gamekeeper.interface.env_source import Source
from gamekeeper.interface.modules import first_on_path, load_file, split_file, within

SYNTAX: Final = "path/to/file.py:factory"
ORDER: Final = 20


def matches(spec: object) -> bool:
    """Tells whether it is a path that ends in `.py`, with or without `:factory`."""
    return isinstance(spec, str | PathLike) and split_file(str(fspath(spec))) is not None


def locate(spec: str | PathLike[str], api: str | None) -> Source:
    """The factory in the file; the file's folder is on `sys.path` while an instance is built."""
    typed, name = split_file(str(fspath(spec))) or (str(spec), None)
    module, path = load_file(typed)
    found = find_factory(module, name, api, where=typed)
    beside = functools.partial(first_on_path, path.parent)
    return Source(
        kind="file",
        factory=found.factory if found.is_single else within(beside, found.factory),
        spec=f"{Path(typed).as_posix()}:{found.name}",
        entry_point=f"{path.name}:{found.name}",
        is_single=found.is_single,
        facts={"path": path.as_posix()},
    )


def distrust(spec: str) -> str | None:
    """Always: anything may stand in a file."""
    return f"{spec} is a file outside the installed packages"
