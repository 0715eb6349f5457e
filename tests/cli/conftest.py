"""Evidence that several files look at, recorded once."""

import contextlib
import os
from pathlib import Path

import pytest

with contextlib.suppress(ImportError):
    import pandas  # noqa: F401  # before it is hidden from the processes that tests start

import gamekeeper as gk
from tests.cli.lines import LINE, ROUGH, SURROUNDINGS


@pytest.fixture(scope="session")
def line_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three episodes of the two robots on a line."""
    run = tmp_path_factory.mktemp("evidence") / "line"
    gk.rollout(LINE, episodes=3, out=run)
    return run


@pytest.fixture(scope="session")
def rough_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two episodes of the rough environment, in which nothing goes wrong."""
    run = tmp_path_factory.mktemp("evidence") / "rough"
    gk.rollout(ROUGH, episodes=2, out=run)
    return run


@pytest.fixture(scope="session")
def _hidden_pandas(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder whose `pandas` can't be imported."""
    folder = tmp_path_factory.mktemp("without_pandas")
    (folder / "pandas.py").write_text("raise ImportError('hidden by the tests')\n")
    return folder


@pytest.fixture(autouse=True)
def _workers_without_pandas(_hidden_pandas: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that tests start run as where pandas isn't installed.

    pyarrow imports it where it can, which takes longer than all else in a short recording.
    """
    monkeypatch.syspath_prepend(_hidden_pandas)
    monkeypatch.setitem(
        SURROUNDINGS, "PYTHONPATH", f"{_hidden_pandas}{os.pathsep}{SURROUNDINGS['PYTHONPATH']}"
    )
