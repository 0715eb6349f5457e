from pathlib import Path

import pyarrow as pa
import pytest

from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.runs.files import parquet_tables, store
from gamekeeper.runs.files import store as roller
from gamekeeper.runs.files.checksums import compare_checksums
from gamekeeper.runs.files.store import RunStore
from tests.runs import run_folders
from tests.runs.run_folders import read


def test_store_gives_back_what_was_appended(tmp_path: Path) -> None:
    """Every stream of a finalized run equals its batches; episodes have one row each."""
    made = RunStore.create(tmp_path / "runs" / "demo", {"name": "demo"})
    run_folders.fill(made, episodes=2, turns=4, flush=2)
    made.finalize({"name": "demo", "fingerprint": "f"})
    run_files = read(tmp_path / "runs" / "demo")
    parts = [
        run_folders.steps(episode, first, stop, acted=first < 4)
        for episode in (0, 1)
        for first, stop in ((0, 2), (2, 4), (4, 5))
    ]
    assert pa.Table.from_batches(parts).equals(run_files.agent_steps)
    assert run_files.agent_steps.schema.field("obs").metadata == {b"shape": b"[3]"}
    assert run_files.episodes.to_pylist() == [
        {"episode": 0, "seed": 0, "turns": 4, "end": "ended"},
        {"episode": 1, "seed": 7, "turns": 4, "end": "ended"},
    ]
    assert run_files.states is not None
    assert run_files.states["turn"].to_pylist() == [0, 1, 2, 3, 4] * 2
    assert run_files.timings is not None
    assert run_files.timings["wall_ns"].to_pylist() == [0, 10, 20, 30] * 2
    assert run_files.finalized
    assert run_files.manifest["fingerprint"] == "f"
    assert run_files.manifest["status"] == "finalized"
    assert run_files.cuts == ()


def test_store_leaves_only_files_that_others_read(tmp_path: Path) -> None:
    """Finalizing takes segments and drafts away."""
    run_folders.finalized_run(tmp_path / "b")
    names = {"episodes", "agent_steps", "states", "timings"}
    expected = {"manifest.json", "frames"} | {f"{name}.parquet" for name in names}
    assert expected == run_folders.names(tmp_path / "b")


def test_store_reads_the_same_open_and_finalized(tmp_path: Path) -> None:
    """A run that ended regularly reads the same before it is finalized and after."""
    made = RunStore.create(tmp_path / "b", {})
    run_folders.fill(made)
    before = read(tmp_path / "b")
    made.finalize({})
    after = read(tmp_path / "b")
    for name in ("episodes", "agent_steps", "states", "timings"):
        assert getattr(before, name).equals(getattr(after, name)), name
    assert (before.finalized, after.finalized) == (False, True)


def test_store_of_nothing_checksums_and_reads(tmp_path: Path) -> None:
    """A run in which no episode began is a run too."""
    made = RunStore.create(tmp_path / "b", {})
    assert read(tmp_path / "b").agent_steps.num_rows == 0
    made.finalize({})
    run_files = read(tmp_path / "b")
    assert (run_files.episodes.num_rows, run_files.agent_steps.num_rows) == (0, 0)
    assert run_files.states is None
    assert run_files.timings is None


@pytest.mark.parametrize("segment_bytes", [1, 3_000, 1 << 20])
def test_store_rolls_segments_of_any_size_into_the_same_table(
    tmp_path: Path, segment_bytes: int
) -> None:
    """However many segments there were, the table is the one of a single segment."""
    made = RunStore.create(tmp_path / "b", {}, segment_bytes=segment_bytes)
    run_folders.fill(made, episodes=3, turns=12)
    opened = read(tmp_path / "b")
    made.finalize({})
    run_folders.finalized_run(tmp_path / "one", episodes=3, turns=12)
    expected = read(tmp_path / "one")
    assert expected.agent_steps.equals(opened.agent_steps)
    assert expected.agent_steps.equals(read(tmp_path / "b").agent_steps)
    assert compare_checksums(tmp_path / "b") == ()


def test_store_takes_columns_that_come_and_go(tmp_path: Path) -> None:
    """A new column is null before it came; a batch without it starts no segment of its own."""
    made = RunStore.create(tmp_path / "b", {})
    made.append("episodes", run_folders.begin(0))
    for turn in range(6):
        batch = run_folders.steps(0, turn, turn + 1)
        if turn in (2, 4):
            batch = batch.append_column("nonconforming", pa.array(["x", None]))
        if turn == 5:
            batch = batch.append_column("action.late", pa.array([1.5, 2.5]))
        made.append("agent_steps", batch)
        made.append("timings", run_folders.timings(0, turn, turn + 1))
    assert len(list((tmp_path / "b").glob("agent_steps-*.arrows"))) == 3
    opened = read(tmp_path / "b").agent_steps
    made.finalize({})
    steps = read(tmp_path / "b").agent_steps
    assert steps.equals(opened)
    assert (
        steps["nonconforming"].to_pylist()
        == [None] * 4 + ["x", None] + [None] * 2 + ["x"] + [None] * 3
    )
    assert steps["action.late"].to_pylist() == [None] * 10 + [1.5, 2.5]


@pytest.mark.parametrize("group_rows", [1, roller.GROUP_ROWS])
def test_store_rolls_again_when_columns_come_late(
    tmp_path: Path, group_rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A draft that was written without a later column is written anew, from the segments."""
    for module in (roller, parquet_tables):
        monkeypatch.setattr(module, "GROUP_ROWS", group_rows)
    made = RunStore.create(tmp_path / "b", {}, segment_bytes=1)
    made.append("episodes", run_folders.begin(0))
    for turn in range(8):
        batch = run_folders.steps(0, turn, turn + 1)
        for late in range(turn // 2):
            batch = batch.append_column(f"late{late}", pa.array([turn, turn]))
        made.append("agent_steps", batch)
    made.finalize({})
    steps = read(tmp_path / "b").agent_steps
    assert [0 if value is None else 1 for value in steps["late0"].to_pylist()] == [0] * 4 + [1] * 12
    assert steps["late2"].drop_null().to_pylist() == [6, 6, 7, 7]


def test_store_refuses_a_column_that_changes_its_type(tmp_path: Path) -> None:
    """Nothing is coerced: integers don't become floats because a float came later."""
    made = RunStore.create(tmp_path / "b", {})
    keys = {"episode": pa.array([0], pa.int32()), "turn": pa.array([0], pa.int32())}
    made.append("agent_steps", pa.record_batch({**keys, "obs": pa.array([2**53 + 1])}))
    keys["turn"] = pa.array([1], pa.int32())
    with pytest.raises(RunError, match="changes its type"):
        made.append("agent_steps", pa.record_batch({**keys, "obs": pa.array([0.5])}))
    made.append("agent_steps", pa.record_batch({**keys, "obs": pa.array([3])}))
    made.finalize({})
    assert read(tmp_path / "b").agent_steps["obs"].to_pylist() == [2**53 + 1, 3]


def test_store_writes_dictionaries_as_their_values(tmp_path: Path) -> None:
    """Agents may be handed over dictionary-encoded; files hold plain text."""
    made = RunStore.create(tmp_path / "b", {})
    for turn in range(2):
        made.append(
            "agent_steps",
            pa.record_batch(
                {
                    "episode": pa.array([0], pa.int32()),
                    "turn": pa.array([turn], pa.int32()),
                    "agent": pa.array([f"picker_{turn}"]).dictionary_encode(),
                }
            ),
        )
    made.finalize({})
    agents = read(tmp_path / "b").agent_steps["agent"]
    assert agents.type == pa.string()
    assert agents.to_pylist() == ["picker_0", "picker_1"]


@pytest.mark.parametrize(
    ("stream", "columns", "message"),
    [
        ("step", {"episode": pa.array([0], pa.int32())}, "no such stream"),
        ("agent_steps", {"episode": pa.array([0], pa.int32())}, "columns"),
        (
            "agent_steps",
            {"turn": pa.array([0], pa.int32()), "episode": pa.array([0], pa.int32())},
            "col",
        ),
        ("episodes", {"episode": pa.array([0], pa.int64())}, "columns"),
        ("episodes", {"episode": pa.array([None], pa.int32())}, "columns"),
        ("episodes", {"episode": pa.array([-1], pa.int32())}, "columns"),
        ("episodes", {"episode": pa.array([1, 0], pa.int32())}, "order"),
        (
            "episodes",
            {"episode": pa.array([0], pa.int32()), "x": pa.array([b"0" * 16], pa.uuid())},
            "columns",
        ),
    ],
)
def test_append_refuses_what_a_run_does_not_hold(
    tmp_path: Path, stream: str, columns: dict[str, pa.Array], message: str
) -> None:
    """Unknown streams, missing or unsorted keys and extension types: nothing is written."""
    made = RunStore.create(tmp_path / "b", {})
    with pytest.raises(RunError, match=message):
        made.append(stream, pa.record_batch(columns))
    assert run_folders.names(tmp_path / "b") == {"manifest.json"}


def test_append_refuses_a_turn_split_over_two_batches(tmp_path: Path) -> None:
    """A turn's rows are in one batch, or a kill between two could keep half of them."""
    made = RunStore.create(tmp_path / "b", {})
    made.append("agent_steps", run_folders.steps(0, 0, 2))
    with pytest.raises(RunError, match="order of turns"):
        made.append("agent_steps", run_folders.steps(0, 1, 3))
    made.append("agent_steps", run_folders.steps(1, 0, 1))


def test_append_of_no_rows_writes_nothing(tmp_path: Path) -> None:
    """An empty batch leaves no file."""
    made = RunStore.create(tmp_path / "b", {})
    made.append("agent_steps", run_folders.steps(0, 0, 0))
    assert run_folders.names(tmp_path / "b") == {"manifest.json"}


def test_closed_store_refuses_more(tmp_path: Path) -> None:
    """After finalizing, every call says that the run is closed; only giving up again is fine."""
    made = RunStore.create(tmp_path / "b", {})
    made.finalize({})
    for call in (
        lambda: made.append("agent_steps", run_folders.steps(0, 0, 1)),
        lambda: made.write_frame("x", b""),
        lambda: made.finalize({}),
    ):
        with pytest.raises(RunError, match="closed"):
            call()
    made.abandon()


def test_checksums_refuses_a_manifest_that_json_cannot_hold(tmp_path: Path) -> None:
    """The error comes before a file is touched, and the run can still be finalized."""
    made = RunStore.create(tmp_path / "b", {})
    run_folders.fill(made)
    with pytest.raises(EvidenceError, match="JSON"):
        made.finalize({"bound": float("inf")})
    with pytest.raises(RunError, match="status"):
        made.finalize({"status": "open"})
    made.finalize({"status": "failed"})
    assert read(tmp_path / "b").manifest["status"] == "failed"


def test_roller_failure_surfaces_at_the_next_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What goes wrong off the thread is raised where the recorder sees it; segments stay."""

    class Broken(roller.TableWriter):
        def add(self, batch: pa.RecordBatch) -> None:
            raise OSError("no more disk")

    monkeypatch.setattr(roller, "TableWriter", Broken)
    monkeypatch.setattr(roller, "GROUP_ROWS", 1)
    made = RunStore.create(tmp_path / "b", {}, segment_bytes=1)
    made.append("agent_steps", run_folders.steps(0, 0, 1))
    made._roller.stop()
    with pytest.raises(RunError, match="rolling agent_steps"):
        made.append("agent_steps", run_folders.steps(0, 1, 2))
    with pytest.raises(RunError, match="rolling"):
        made.finalize({})
    assert {"manifest.json", "agent_steps-0000.arrows"} == run_folders.names(tmp_path / "b")
    assert read(tmp_path / "b").manifest["format_version"] == store.FORMAT_VERSION
