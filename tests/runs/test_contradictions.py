"""A run whose rows contradict what it says of itself, though all checksums were made to fit."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gamekeeper as gk
from gamekeeper.errors import RunError
from tests.runs.finalize_again import finalize_again_table


def column(run: Path, table: str, name: str, change: Callable[[list[Any]], list[Any]]) -> None:
    """Writes a column of a table anew, and makes the checksums fit."""
    rows = pq.read_table(run / f"{table}.parquet")
    place = rows.schema.get_field_index(name)
    field = rows.schema.field(place)
    values = pa.array(change(rows.column(name).to_pylist()), field.type)
    finalize_again_table(run, table, rows.set_column(place, field, values))


def rewards(run: Path) -> None:
    """Another reward in each row that has one."""
    column(run, "agent_steps", "reward", lambda x: [each and each + 1.0 for each in x])


def steps(run: Path) -> None:
    """More steps than were played."""
    column(run, "episodes", "turns", lambda x: [x[0] + 9, *x[1:]])


def too_few(run: Path) -> None:
    """Fewer."""
    column(run, "episodes", "turns", lambda x: [x[0] - 1, *x[1:]])


def rows_twice(run: Path) -> None:
    """Rows of the first episode behind the last."""
    rows = pq.read_table(run / "agent_steps.parquet")
    finalize_again_table(run, "agent_steps", pa.concat_tables([rows, rows.slice(0, 3)]))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two episodes."""
    run = tmp_path_factory.mktemp("recorded") / "run"
    gk.rollout("two_robot_line", policies="reference", episodes=2, seed=3, out=run)
    return run


@pytest.fixture
def two_runs(recorded: Path, tmp_path: Path) -> tuple[Path, Path]:
    """Two copies of it."""
    for name in ("a", "b"):
        shutil.copytree(recorded, tmp_path / name)
    return tmp_path / "a", tmp_path / "b"


@pytest.mark.parametrize("change", [rewards, steps, too_few, rows_twice])
def test_a_run_that_contradicts_itself_is_believed_by_nothing(
    two_runs: tuple[Path, Path], change: Callable[[Path], None]
) -> None:
    """`verify` says so, `diff` refuses it: the manifest's word alone makes no two runs the same."""
    one, other = two_runs
    assert gk.diff(one, other) is None
    change(other)
    found = gk.verify(other)
    assert not found.ok
    assert not found.self_consistent
    assert found.damage
    with pytest.raises(RunError):
        gk.diff(one, other)


def test_replay_of_a_changed_run_names_the_change(two_runs: tuple[Path, Path]) -> None:
    """Where its rows don't fit its fingerprint, the environment isn't suspected."""
    one, _ = two_runs
    rewards(one)
    replay = gk.replay(one, allow_import=True)
    assert replay.divergence is not None
    assert replay.divergence.field == "reward"
    assert replay.cause is not None
    assert "changed once it was recorded" in replay.cause


def test_replay_compares_the_number_of_steps(two_runs: tuple[Path, Path]) -> None:
    """A number that no row shows is no part of a verified run."""
    steps(two_runs[0])
    replay = gk.replay(two_runs[0], allow_import=True)
    assert not replay.verified
    assert replay.divergence is not None
    assert replay.divergence.field == "turns"
