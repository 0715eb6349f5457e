"""Files and registrations that last for one test of opening."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pettingzoo
import pytest

Write = Callable[..., str]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Write]:
    """Writes a file and gives its path; what it made Python import is forgotten afterwards."""
    before, path = set(sys.modules), sys.path[:]

    def write(text: str, name: str = "field.py") -> str:
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return str(file)

    yield write
    assert path == sys.path, "opening left something on sys.path"
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


@pytest.fixture
def register() -> Iterator[Callable[..., None]]:
    """Registers environments for one test."""
    saved = [(reg, dict(reg)) for reg in (pettingzoo.aec_registry, pettingzoo.parallel_registry)]
    yield pettingzoo.register
    for registry, before in saved:
        registry.clear()
        registry.update(before)
