"""Tests of trainers, which `make test` doesn't run: CI runs those whose packages are locked.

Of the others, mypy sees names, attributes and arguments that a rename has missed, and this file
the texts of errors: both need none of the trainers' packages.
"""

import ast
import re
import tomllib

from tests.surface.sources import PACKAGE, ROOT

LISTS = ROOT / "requirements" / "trainers"
LOCKED = sorted(path.stem for path in LISTS.glob("*.txt"))
UNLOCKED = sorted(path.stem for path in LISTS.glob("*.in") if path.stem not in LOCKED)
TESTS = sorted(path for name in UNLOCKED for path in (ROOT / "tests").rglob(f"*{name}*.py"))


def test_ci_runs_the_tests_of_every_locked_trainer() -> None:
    """Those with a lock file, each in an environment that CI takes away afterwards."""
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert sorted(re.findall(r"make trainer-test TRAINER=(\w+)", script)) == LOCKED
    assert sorted({"browser", *LOCKED}) == sorted(re.findall(r'"\$VENV-(\w+)"', script))
    page = (ROOT / "docs" / "trainers.md").read_text(encoding="utf-8").split("\n## ")[0]
    assert all(f"`{name}`" in page for name in LOCKED)


def test_types_are_checked_in_the_tests_of_every_other_trainer() -> None:
    """A name or an argument that was renamed in an adapter is found by `make types`."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    checked = {path for pattern in settings["files"] for path in ROOT.glob(pattern)}
    assert len(TESTS) > len(UNLOCKED)
    assert [path for path in TESTS if path not in checked] == []


def test_errors_that_they_wait_for_can_be_said() -> None:
    """Every `match="..."` fits a text of the sources."""
    sources = "".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    said = re.sub(r"""["']\s*\n\s*f?["']""", "", sources)  # texts over several lines
    waited = {
        node.value.value
        for path in TESTS
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.keyword) and node.arg == "match"
        if isinstance(node.value, ast.Constant)
    }
    assert len(waited) > len(UNLOCKED)
    assert sorted(w for w in waited if not re.search(w, said)) == []
