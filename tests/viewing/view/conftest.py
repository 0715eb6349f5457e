"""A run that several tests look at, and a visitor of it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from gamekeeper.runs.recording import rollout
from gamekeeper.viewing import viewer_runs as book
from gamekeeper.viewing.viewer import Viewer
from tests.viewing.view.visiting import Visitor


@pytest.fixture(scope="session")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four episodes of the two robots on a line."""
    run = tmp_path_factory.mktemp("view") / "line"
    rollout("two_robot_line", episodes=4, out=run)
    return run


@pytest.fixture(scope="session")
def visitor(line: Path) -> Iterator[Visitor]:
    """Visits a view of that run."""
    with Viewer([line]) as view:
        yield Visitor(view)


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs are read anew at every request, which waits for it."""
    monkeypatch.setattr(book, "SOONEST_S", 0.0)
    monkeypatch.setattr(book, "SHARE", 0.0)
