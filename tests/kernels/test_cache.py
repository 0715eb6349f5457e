"""Compiled code on disk: what is used stays, what isn't makes room."""

import os
from pathlib import Path

from gamekeeper.kernels.compile_cache import SUFFIX, make_room


def kept(folder: Path) -> set[str]:
    """The names of what lies there."""
    return {file.name for file in folder.iterdir()}


def test_make_room_removes_what_was_used_longest_ago(tmp_path: Path) -> None:
    """And nothing that isn't compiled code."""
    for age, name in enumerate("abcd"):
        file = tmp_path / f"{name}{SUFFIX}"
        file.write_bytes(b"code")
        os.utime(file, (1_000 - age, 1_000 - age))
    (tmp_path / "cache.cpython-311.pyc").write_bytes(b"Python's")
    make_room(tmp_path, most=2)
    assert kept(tmp_path) == {f"a{SUFFIX}", f"b{SUFFIX}", "cache.cpython-311.pyc"}
    make_room(tmp_path, most=2)
    assert len(kept(tmp_path)) == 3


def test_make_room_of_a_missing_folder_is_nothing(tmp_path: Path) -> None:
    """It is asked for after every write, and others clean up too."""
    make_room(tmp_path / "gone")
    assert kept(tmp_path) == set()
