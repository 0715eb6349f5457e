"""`import gamekeeper` is cheap: what is heavy is loaded by the name that needs it."""

import subprocess
import sys

import pytest

from tests.surface.sources import ROOT

HEAVY = [
    "numpy",
    "pyarrow",
    "pettingzoo",
    "gymnasium",
    "pandas",
    "duckdb",
    "typer",
    "rich",
    "blake3",
]
HEAVY += ["asyncio", "multiprocessing", "importlib.metadata"]


def modules_after(statement: str) -> set[str]:
    """The modules that a fresh interpreter has loaded after a statement."""
    code = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT / "src", capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "statement", ["import gamekeeper", "import gamekeeper.errors", "dir(__import__('gamekeeper'))"]
)
def test_import_loads_nothing_heavy(statement: str) -> None:
    """Neither the package nor its errors nor a look at its names load numpy or anything heavier."""
    assert modules_after(statement) & set(HEAVY) == set()


def test_import_loads_little_of_its_own() -> None:
    """The package's front loads itself, its version and at most its errors."""
    ours = {name for name in modules_after("import gamekeeper") if name.startswith("gamekeeper")}
    assert ours <= {"gamekeeper", "gamekeeper._version", "gamekeeper.errors"}
