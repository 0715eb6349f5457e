"""Evidence that several files look at, recorded once."""

from pathlib import Path

import pytest

import gamekeeper as gk
from tests.cli.lines import LINE, ROUGH


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
