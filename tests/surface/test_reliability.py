"""The tables of faults name tests that exist."""

import ast
import re
from functools import cache
from itertools import takewhile
from pathlib import Path

import pytest

from tests.surface.sources import ROOT

PAGES = [path for path in (ROOT / "docs").glob("*.md") if path.stem in ("reliability", "security")]
NAMED = re.compile(r"`([\w/.-]+\.py)::(\w+)`")


@cache
def names_in(path: Path) -> frozenset[str]:
    """The names of the functions of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_tests_exist(page: Path) -> None:
    """Every `file.py::test` on a page that promises something is there, under that name."""
    named = NAMED.findall(page.read_text(encoding="utf-8"))
    assert named
    missing = [
        f"{file}::{name}"
        for file, name in named
        if not (ROOT / "tests" / file).exists() or name not in names_in(ROOT / "tests" / file)
    ]
    assert missing == []


def test_every_fault_has_a_test_or_a_script() -> None:
    """A row without a proof is a promise that nobody keeps."""
    lines = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8").splitlines()
    at = [n for n, line in enumerate(lines) if line.startswith("| fault |")]
    rows = [
        line
        for start in at
        for line in takewhile(lambda line: line.startswith("|"), lines[start + 2 :])
    ]
    assert rows
    assert [row for row in rows if ".py" not in row] == []
