"""Processes of ours don't load pandas, and nobody can tell."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pandas")

START = (
    "import sys; from gamekeeper.rollouts.pandas_later import pandas_can_wait; pandas_can_wait()\n"
)
LOADED = "print('pandas' in sys.modules)\n"


def printed(code: str, *arguments: str) -> list[str]:
    """The lines that a fresh interpreter prints."""
    line = [sys.executable, "-W", "ignore", "-c", code, *arguments]
    return subprocess.run(line, capture_output=True, text=True, check=True).stdout.split("\n")[:-1]


def test_pyarrow_starts_without_pandas() -> None:
    """Arrays are made, read and calculated with, and pandas isn't loaded."""
    code = (
        "import numpy as np, pyarrow as pa, pyarrow.compute as pc\n"
        "print(pc.sum(pa.array(np.arange(4))).as_py(), pa.array([1, None]).to_numpy(False)[0])\n"
    )
    assert printed(START + code + LOADED) == ["6 1.0", "False"]
    assert printed("import sys\n" + code + LOADED) == ["6 1.0", "True"]  # what this is for


@pytest.mark.parametrize("first", ["import pyarrow as pa, pandas as pd", "import pandas as pd"])
def test_pandas_works_with_pyarrow_once_it_is_imported(first: str) -> None:
    """A Series is converted by pyarrow as ever: by position, with null for what is missing."""
    code = (
        f"{first}\nimport pyarrow as pa\n"
        "series = pd.Series([1.0, float('nan')], index=[4, 5])\n"
        "print(pa.array(series).to_pylist(), pa.table({'a': [1]}).to_pandas().a.sum())\n"
    )
    assert printed(START + code) == ["[1.0, None] 1"]


def test_pandas_is_imported_where_pyarrow_is_asked_for_a_frame() -> None:
    """Whoever asks pyarrow itself for a frame gets one."""
    assert printed(
        START + "import pyarrow as pa; print(len(pa.table({'a': [1]}).to_pandas()))"
    ) == ["1"]


def test_command_line_does_not_load_pandas(tmp_path: Path) -> None:
    """Recording and showing take no time for it in any of their processes."""
    code = (
        "import sys; from gamekeeper.cli import main\nprint(main(sys.argv[1:]), file=sys.stderr)\n"
    )
    run = str(tmp_path / "run")
    for line in (["rollout", "two_robot_line", "--episodes", "1", "--out", run], ["show", run]):
        assert printed(code + LOADED, *line)[-1] == "False"
