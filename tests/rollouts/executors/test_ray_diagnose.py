"""Diagnosis and attribution played on Ray: the answers of one process."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.errors import GamekeeperError
from gamekeeper.import_guard import guarded
from gamekeeper.rollouts.executors.ray import RayExecutor
from gamekeeper.rollouts.executors.task import WorkTask
from tests.cli.lines import document

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.trainer

QUICK = ("--no-perturbations", "--episodes", 300)
FEW = ("--episodes", 2, "--action-episodes", 4)


@pytest.fixture
def executor() -> Iterator[RayExecutor]:
    """Two cores of a cluster of this machine's."""
    with RayExecutor(workers=2) as found:
        yield found


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run that fails, as one of its agents acts late."""
    path = tmp_path / "run"
    gk.rollout(
        "handover",
        policies="reference",
        episodes=3,
        out=path,
        env_kwargs={"latency": {"giver_0": 3}},
    )
    return path


def test_functions_give_the_same_answers_on_ray(executor: RayExecutor, run: Path) -> None:
    """Ideal substitutes and perturbations, coalitions and single actions, each figure of them."""
    here, far = (
        gk.diagnose(run, episodes=700, perturbations=True, workers=players)
        for players in (0, executor)
    )
    assert far.to_json() == here.to_json()
    assert far.agents["giver_0"].labels == ("timing",)
    assert {each.kind for each in far.agents["giver_0"].tested} == {"ideal", "perturbation"}
    here, far = (
        gk.attribute(run, episodes=3, action_episodes=4, workers=players)
        for players in (0, executor)
    )
    assert far.to_json() == here.to_json()
    assert far.fresh == 3


def test_diagnosis_on_ray_goes_on_from_what_was_played(
    executor: RayExecutor, run: Path, tmp_path: Path
) -> None:
    """What one executor played is known to another."""
    first, second = (
        gk.diagnose(run, episodes=100, perturbations=False, workers=players, out=tmp_path / "d")
        for players in (executor, 0)
    )
    assert first.episodes > 0
    assert second.episodes == 0
    assert second.agents == first.agents


@pytest.mark.parametrize("line", [("diagnose", *QUICK), ("attribute", *FEW)])
def test_commands_give_the_same_answers_on_ray(
    line: tuple[object, ...], run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """As they are typed: exit codes and documents."""
    answers = []
    for players in (["--executor", "ray"], []):
        answers.append(document(capfd, *line[:1], run, *line[1:], "--workers", 2, *players))
        for played in ("diagnosis", "attribution"):  # else the second goes on from there
            shutil.rmtree(f"{run}-{played}", ignore_errors=True)
    assert answers[0] == answers[1]
    assert answers[0][0] == 0


def test_processes_of_ray_obey_the_import_guard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They find no module in the current folder, where PYTHONPATH names it."""
    (tmp_path / "google.py").write_text("open('executed', 'w').close()\nraise ImportError\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", ".")
    task = WorkTask("t", "tests.rollouts.executors.executor_tasks:twice", {"number": 2})
    with guarded(), RayExecutor(workers=1) as executor:
        (done,) = executor.map([task])
    assert done.outcome.value == 4
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["google.py"]


def test_ray_that_does_not_start_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever it raises; where a node is late, that is an Exception and no more."""

    def late(**how: object) -> None:
        raise Exception("The current node timed out during startup.")

    monkeypatch.setattr(ray, "init", late)
    with pytest.raises(GamekeeperError, match="no Ray cluster can be started here") as caught:
        _ = RayExecutor().workers
    assert "timed out" in caught.value.actual
