"""`gamekeeper show RUN`: returns over episodes as pictures, also where a terminal has no blocks."""

from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.reporting.text_columns import ASCII, BLOCKS
from tests.cli.lines import document, run_apart, said


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five episodes whose returns differ."""
    folder = tmp_path_factory.mktemp("show") / "run"
    gk.rollout("handover", episodes=5, seed=1, out=folder)
    return folder


def test_show_draws_returns_over_episodes(run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A sign for each episode, for each agent; the document has the numbers."""
    _, out, _ = said(capfd, "show", run)
    lines = out.partition("Returns over episodes\n")[2].splitlines()[:2]
    assert [line.split()[0] for line in lines] == ["giver_0", "receiver_0"]
    assert all(len(line.split()[1]) == 5 and set(line.split()[1]) <= set(BLOCKS) for line in lines)
    assert max(map(len, out.splitlines())) <= 80
    code, found = document(capfd, "show", run)
    means = {name: each.return_mean for name, each in gk.load(run).summary.agents.items()}
    assert code == 0
    assert {n: sum(values) / 5 for n, values in found["returns"].items()} == pytest.approx(means)


def test_show_draws_one_episode_not_at_all(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """One value has no course."""
    gk.rollout("handover", episodes=1, out=tmp_path / "run")
    assert "Returns over" not in said(capfd, "show", tmp_path / "run")[1]


def test_show_keeps_to_ascii_where_it_has_to(run: Path, tmp_path: Path) -> None:
    """A terminal without blocks gets the same heights in ASCII, and no question marks."""
    done = run_apart("show", run, cwd=tmp_path, env={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0
    line = done.stdout.partition("Returns over episodes\n")[2].splitlines()[0]
    assert set(line.split()[1]) <= set(ASCII)
