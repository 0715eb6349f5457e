"""What dies between the run's taking its place and the end of the command."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.errors import EnvError, RunError
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.workers import TaskOutcome
from gamekeeper.runs.parts import fan_out as apart
from gamekeeper.runs.parts.part_plan import FOLDER, MERGED, PLAN, parts_folder
from tests.runs.parts.here import Here, apart_into, called, plan, tasks_run_here

__all__ = ["tasks_run_here"]

pytestmark = pytest.mark.usefixtures("tasks_run_here")


def merged_and_killed(out: Path, **changed: Any) -> str:
    """Records a plan up to where its parts would be taken away; the fingerprint."""

    def die(storage: object) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as killed:
        killed.setattr(apart, "release", die)
        with pytest.raises(KeyboardInterrupt):
            apart_into(out, plan(**changed))
    assert parts_folder(out).exists()
    return gk.load(out).fingerprint


def test_merged_run_is_whole_though_what_merged_it_died(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed with its work done, before it could say so, it has done its work."""

    def died(call: str, arguments: Any, **options: Any) -> TaskOutcome:
        called(call, arguments)
        return TaskOutcome("died", None, "killed by SIGKILL", None, 0.0)

    monkeypatch.setattr(apart, "run_task", died)
    done = apart_into(tmp_path / "many", plan())
    assert (done.error, done.parts) == (None, 6)
    assert gk.load(tmp_path / "many").manifest["status"] == "finalized"
    assert [path.name for path in tmp_path.iterdir()] == ["many"]


@pytest.mark.parametrize("gone", [(), (FOLDER,), (FOLDER, PLAN)], ids=["none", "parts", "plan"])
def test_merged_run_ends_with_the_same_command(gone: tuple[str, ...], tmp_path: Path) -> None:
    """Wherever the parent was killed while it took the parts away: nothing is played again."""
    fingerprint, place = merged_and_killed(tmp_path / "many"), parts_folder(tmp_path / "many")
    for name in gone:
        (place / name).rename(tmp_path / f"away-{name}")
    executor = Here()
    done = apart_into(tmp_path / "many", plan(), executor)
    assert (done.error, done.parts, done.found, executor.played) == (None, 6, 6, [])
    assert gk.load(tmp_path / "many").fingerprint == fingerprint
    assert not place.exists()


def test_merged_run_that_failed_says_so_again(tmp_path: Path) -> None:
    """The error of its first failure is told by the same command, with or without parts."""
    changed = {"env_kwargs": {"fails": [episode_seed(3, 1)]}}
    merged_and_killed(tmp_path / "many", **changed)
    done = apart_into(tmp_path / "many", plan(**changed))
    assert isinstance(done.error, EnvError)
    assert done.parts == 2
    assert not parts_folder(tmp_path / "many").exists()


def test_merged_run_of_another_command_is_refused(tmp_path: Path) -> None:
    """Another plan, or none of ours any more: the folder isn't empty, and nothing is taken away."""
    merged_and_killed(tmp_path / "many")
    with pytest.raises(RunError, match="a run is there already"):
        apart_into(tmp_path / "many", plan(seed=9))
    gk.rollout("two_robot_line", episodes=1, out=tmp_path / "other")
    (tmp_path / "many").rename(tmp_path / "away")
    (tmp_path / "other").rename(tmp_path / "many")
    with pytest.raises(RunError, match="a run is there already"):
        apart_into(tmp_path / "many", plan())
    assert (parts_folder(tmp_path / "many") / MERGED).exists()


@pytest.mark.parametrize(
    "harm",
    [
        lambda data: b"",
        lambda data: b"[" * 100_000,
        lambda data: data.replace(b'"parts": 6', b'"parts": "6"'),
        lambda data: data.replace(b'"error": null', b'"error": {"kind": 3}'),
    ],
    ids=["empty", "deep", "parts", "error"],
)
def test_merged_note_that_is_none_is_not_believed(
    harm: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    """What can't be read says nothing: the run is refused as anything else that lies there."""
    merged_and_killed(tmp_path / "many")
    note = parts_folder(tmp_path / "many") / MERGED
    note.write_bytes(harm(note.read_bytes()))
    with pytest.raises(RunError, match="a run is there already"):
        apart_into(tmp_path / "many", plan())
