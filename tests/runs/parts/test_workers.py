"""Recordings by processes that are killed, hang or die: the kernel's part is no mock here."""

from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.errors import EnvError
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import Limits
from gamekeeper.runs.parts.fan_out import record_apart
from gamekeeper.runs.parts.part_plan import parts_folder
from gamekeeper.runs.run_check import verify
from tests.runs.parts.here import CROWD, plan


def test_killed_worker_costs_time_and_nothing_else(tmp_path: Path) -> None:
    """A worker that is killed -9 in mid-run is replaced; one and two workers record the same."""
    mark = tmp_path / "mark"
    wanted = plan(env_kwargs={"kills": str(mark)}, episodes=4)
    done = record_apart(
        wanted,
        tmp_path / "killed",
        executor=LocalExecutor(2),
        storage=Storage.at(parts_folder(tmp_path / "killed")),
    )
    assert mark.exists()
    assert (done.error, done.deaths, done.parts) == (None, 1, 4)
    options = {"episodes": 4, "seed": 3, "env_kwargs": {"kills": str(mark)}}
    one = gk.rollout(CROWD, out=tmp_path / "one", **options)
    two = gk.rollout(CROWD, out=tmp_path / "two", workers=1, **options)
    found = verify(tmp_path / "killed", fingerprint=one.fingerprint)
    assert found.ok, str(found)
    assert one.fingerprint == two.fingerprint
    assert not parts_folder(tmp_path / "killed").exists()


@pytest.mark.parametrize("is_far", [False, True])
def test_death_each_time_ends_the_run_as_failed(is_far: bool, tmp_path: Path) -> None:
    """An environment that ends every process leaves what was played until then, and says so."""
    wanted = plan(env_kwargs={"dies": [episode_seed(3, 2)]}, episodes=4)
    storage = Storage.at((tmp_path / "far").as_uri() if is_far else parts_folder(tmp_path / "run"))
    done = record_apart(
        wanted,
        tmp_path / "run",
        executor=LocalExecutor(2),
        storage=storage,
        limits=Limits(attempts=2),
    )
    assert isinstance(done.error, EnvError)
    assert done.error.actual == "exit code 5"
    assert done.deaths == 1
    evidence = gk.load(tmp_path / "run")
    assert evidence.manifest["status"] == "failed"
    assert "exit code 5" in str(evidence.manifest["error"])
    rows = evidence.episode_table.to_pylist()
    assert [row["end"] for row in rows] == ["ended", "ended"] + ["failed"] * (not is_far)
    if not is_far:  # where parts are written to a worker's own disk, nothing of a dead one is left
        assert (rows[2]["turns"], "exit code 5" in rows[2]["error"]) == (2, True)
    assert verify(tmp_path / "run").ok


def test_workers_report_failures_as_one_process_does(tmp_path: Path) -> None:
    """`gk.rollout` raises what the environment raised, and leaves the same evidence."""
    options = {"episodes": 3, "seed": 3, "env_kwargs": {"fails": [episode_seed(3, 1)]}}
    counted: list[int] = []
    with pytest.raises(EnvError, match="the crowd is stuck"):
        gk.rollout(CROWD, out=tmp_path / "two", workers=2, after_episode=counted.append, **options)
    with pytest.raises(EnvError, match="the crowd is stuck"):
        gk.rollout(CROWD, out=tmp_path / "one", **options)
    one, two = gk.load(tmp_path / "one"), gk.load(tmp_path / "two")
    assert (one.fingerprint, one.manifest["status"]) == (two.fingerprint, "failed")
    assert counted[-1] >= 1
