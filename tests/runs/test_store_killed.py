"""What is left of a run whose process died, and how it is finalized."""

import errno
import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gamekeeper as gk
from gamekeeper.errors import RunError
from gamekeeper.runs.files import checksums as checksums_module
from gamekeeper.runs.files.checksums import compare_checksums
from gamekeeper.runs.files.open_streams import finalize_recovered, open_tables, whole_turns
from gamekeeper.runs.files.segments import SegmentReader, SegmentWriter
from gamekeeper.runs.files.store import RunStore
from tests.runs import run_folders
from tests.runs.run_folders import RunFiles, read

APPENDING = """
import os, sys
from gamekeeper.runs.files.store import RunStore
from tests.runs import run_folders
store = RunStore.create(sys.argv[1], {}, segment_bytes=int(sys.argv[2]))
store.append("episodes", run_folders.begin(0))
for turn in range(1_000_000):
    store.append("agent_steps", run_folders.steps(0, turn, turn + 1))
    store.append("timings", run_folders.timings(0, turn, turn + 1))
    os.write(1, b"%d\\n" % turn)
"""


@pytest.mark.parametrize(("segment_bytes", "turns"), [(1 << 20, 1), (4_000, 37)])
def test_killed_process_loses_no_appended_batch(
    tmp_path: Path, segment_bytes: int, turns: int
) -> None:
    """Every turn that was appended before kill -9 is read, also while segments are being rolled."""
    command = [sys.executable, "-c", APPENDING, str(tmp_path / "b"), str(segment_bytes)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout
        for _ in range(turns):
            run.stdout.readline()
        run.send_signal(signal.SIGKILL)
        appended = turns + len(run.stdout.readlines())
    run_files = read(tmp_path / "b")
    kept = run_files.agent_steps.num_rows // len(run_folders.AGENTS)
    assert appended <= kept <= appended + 1
    finalize_recovered(tmp_path / "b", {})
    assert run_files.agent_steps.equals(read(tmp_path / "b").agent_steps)
    assert compare_checksums(tmp_path / "b") == ()


def test_segment_cut_at_any_byte_gives_its_whole_batches(tmp_path: Path) -> None:
    """A file that ends anywhere reads without an error; each batch is there once its bytes are."""
    path = tmp_path / "timings-0000.arrows"
    writer = SegmentWriter(path, run_folders.timings(0, 0, 1).schema)
    sizes = []
    for turn in range(2):
        writer.write(run_folders.timings(0, turn, turn + 1))
        sizes.append(writer.size)
    writer.finish()
    data = path.read_bytes()
    for size in range(len(data) + 1):
        path.write_bytes(data[:size])
        reader = SegmentReader(path, "timings")
        assert len(list(reader)) == sum(size >= whole for whole in sizes)
        assert (reader.cut is None) == (size in (0, _head(data), *sizes, len(data)))
        assert reader.ended == (size == len(data))


def _head(data: bytes) -> int:
    """Bytes of a segment's schema message."""
    return 8 + int.from_bytes(data[4:8], "little")


@pytest.mark.parametrize("stream", ["episodes", "agent_steps", "states", "timings"])
def test_torn_segment_keeps_whole_turns(tmp_path: Path, stream: str) -> None:
    """Wherever a stream is cut: the more of it, the more turns are kept, and never half a turn."""
    whole = read(run_folders.open_run(tmp_path / "b", episodes=2, turns=4))
    path = tmp_path / "b" / f"{stream}-0000.arrows"
    data = path.read_bytes()
    counts = []
    for size in [*range(0, len(data), 211), len(data)]:
        path.write_bytes(data[:size])
        run_files = read(tmp_path / "b")
        _is_prefix(run_files, whole)
        counts.append(run_files.agent_steps.num_rows)
    assert sorted(counts) == counts
    assert whole.agent_steps.num_rows == counts[-1]
    path.write_bytes(data[:-1])
    assert f"{stream}-0000.arrows" == read(tmp_path / "b").cuts[0].file


@given(st.data())
@settings(max_examples=25)
def test_streams_cut_anywhere_agree(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """With every stream cut somewhere else, what is kept fits together, and recovers the same."""
    path = run_folders.open_run(tmp_path_factory.mktemp("cut") / "b", episodes=3, turns=4)
    for stream in ("episodes", "agent_steps", "states", "timings"):
        segment = path / f"{stream}-0000.arrows"
        part = data.draw(st.floats(0, 1), label=stream)
        segment.write_bytes(segment.read_bytes()[: int(part * segment.stat().st_size)])
    run_files = read(path)
    finished = _turns_of(run_files.timings)
    acted = run_files.agent_steps
    if len(acted):
        acted = acted.filter(acted["order"].is_valid())
    assert _turns_of(acted) == finished
    assert finished <= _turns_of(run_files.states)
    begun = set(run_files.episodes["episode"].to_pylist())
    assert {episode for episode, _ in _turns_of(run_files.agent_steps)} <= begun
    for row in run_files.episodes.to_pylist():
        assert row["turns"] in (None, sum(episode == row["episode"] for episode, _ in finished))
    finalize_recovered(path, {})
    again = read(path)
    assert again.agent_steps.to_pylist() == run_files.agent_steps.to_pylist()
    assert again.episodes.to_pylist() == run_files.episodes.to_pylist()


def _turns_of(table: pa.Table | None) -> set[tuple[int, int]]:
    if table is None:
        return set()
    return set(zip(table["episode"].to_pylist(), table["turn"].to_pylist(), strict=True))


def test_run_reads_while_it_is_recorded(tmp_path: Path) -> None:
    """Each look at a growing run sees whole turns, and never fewer than the look before."""
    store = RunStore.create(tmp_path / "b", {}, segment_bytes=20_000)
    done = threading.Event()

    def record() -> None:
        run_folders.fill(store, episodes=4, turns=20)
        done.set()

    recorder = threading.Thread(target=record)
    recorder.start()
    seen = [0]
    while not done.is_set():
        run_files = read(tmp_path / "b")
        if (
            run_files.timings is None
        ):  # its first file comes after the first rows: nothing to compare
            continue
        finished = run_files.timings.num_rows
        steps = run_files.agent_steps
        acted = steps["order"].drop_null().length() if len(steps) else 0
        assert acted == finished * len(run_folders.AGENTS)
        seen.append(finished)
    recorder.join()
    store.finalize({})
    assert sorted(seen) == seen
    assert len(_turns_of(read(tmp_path / "b").timings)) == 80


def test_missing_end_of_a_middle_segment_ends_the_stream(tmp_path: Path) -> None:
    """Segments after a cut one don't count: there would be a hole before them."""
    store = RunStore.create(tmp_path / "b", {}, segment_bytes=1)
    run_folders.fill(store, episodes=1, turns=6)
    store.abandon()
    path = tmp_path / "b" / "agent_steps-0001.arrows"
    path.write_bytes(path.read_bytes()[:-20])
    run_files = read(tmp_path / "b")
    assert run_files.agent_steps["turn"].to_pylist() == [0, 0, 1, 1]
    assert any("later segments" in cut.why for cut in run_files.cuts)
    (tmp_path / "b" / "agent_steps-0000.arrows").unlink()
    with pytest.raises(RunError, match=r"agent_steps-0000\.arrows is missing"):
        read(tmp_path / "b")
    run_files = read(tmp_path / "b", salvage=True)
    assert run_files.agent_steps.num_rows == 0
    assert [cut.why for cut in run_files.cuts] == ["the segment is missing"]


@pytest.mark.parametrize("step", range(9))
def test_killed_while_finalizing_the_run_still_reads(
    tmp_path: Path, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wherever finalizing stops, what is read is the same, and recovering finishes it."""
    run_folders.finalized_run(tmp_path / "whole")
    store = RunStore.create(tmp_path / "b", {})
    run_folders.fill(store)
    store.write_frame("0.png", b"picture")
    calls, drafts = iter(range(100)), _drafts(store)

    class Killed(BaseException):
        pass

    def dies_at(method: object) -> object:
        def call(*arguments: object, **options: object) -> object:
            if next(calls) == step:
                raise Killed
            return method(*arguments, **options)  # type: ignore[operator]

        return call

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", dies_at(Path.replace))
        patch.setattr(Path, "unlink", dies_at(Path.unlink))
        manifest = {"status": "finalized", "format_version": 1}
        with suppress(Killed):
            checksums_module.commit(tmp_path / "b", manifest, drafts)
    expected, run_files = read(tmp_path / "whole"), read(tmp_path / "b")
    for name in ("episodes", "agent_steps", "states", "timings"):
        assert getattr(expected, name).equals(getattr(run_files, name)), name
    store._close()
    if not run_files.finalized:
        finalize_recovered(tmp_path / "b", {})
    assert expected.agent_steps.equals(read(tmp_path / "b").agent_steps)
    assert compare_checksums(tmp_path / "b") == ()


def _drafts(store: RunStore) -> dict[str, tuple[Path, int, str]]:
    """What finalizing has written just before it gives the files their names."""
    found: dict[str, tuple[Path, int, str]] = {}
    original = checksums_module.commit
    module = sys.modules["gamekeeper.runs.files.store"]
    try:
        module.commit = lambda _folder, _manifest, files, **_: found.update(files)  # type: ignore  # a stub, put back below
        store._finalize({})
    finally:
        module.commit = original  # type: ignore  # puts it back
    return found


def test_recover_checksums_what_read_gives(tmp_path: Path) -> None:
    """Recovering keeps the whole turns, drops the unfinished one, and says where files were cut."""
    run_folders.open_run(tmp_path / "b", episodes=2, turns=6)
    for stream, size in (("agent_steps", 100), ("timings", 0)):
        path = tmp_path / "b" / f"{stream}-0000.arrows"
        path.write_bytes(path.read_bytes()[: -1 - size])
    before = read(tmp_path / "b")
    finalize_recovered(tmp_path / "b", {"name": "demo"})
    after = read(tmp_path / "b")
    cuts = after.manifest["cuts"]
    assert {"agent_steps-0000.arrows", "timings-0000.arrows"} == {cut["file"] for cut in cuts}
    assert after.manifest["status"] == "recovered"
    for name in ("episodes", "agent_steps", "states", "timings"):
        assert getattr(before, name).equals(getattr(after, name)), name
    assert after.episodes["end"].to_pylist() == ["ended", None]
    assert not list((tmp_path / "b").glob("*.arrows"))


def test_recover_takes_other_rows_of_episodes(tmp_path: Path) -> None:
    """Whoever recovers may say how each episode ended."""
    run_folders.open_run(tmp_path / "b", episodes=1)
    rows = pa.table({"episode": pa.array([0], pa.int32()), "end": ["torn"]})
    finalize_recovered(tmp_path / "b", {}, episodes=rows)
    assert read(tmp_path / "b").episodes["end"].to_pylist() == ["torn"]


def test_recover_refuses_what_is_not_dead(tmp_path: Path) -> None:
    """A finalized run, one that is being recorded, and no run at all are left alone."""
    run_folders.finalized_run(tmp_path / "finalized")
    with pytest.raises(RunError, match="finalized already"):
        finalize_recovered(tmp_path / "finalized", {})
    store = RunStore.create(tmp_path / "live", {})
    with pytest.raises(RunError, match="being recorded"):
        finalize_recovered(tmp_path / "live", {})
    store.abandon()
    finalize_recovered(tmp_path / "live", {})
    with pytest.raises(RunError):
        finalize_recovered(tmp_path / "none", {})


def test_recover_on_a_full_disk_leaves_the_run_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing half-made stays behind, and recovering again, with space, works."""
    run_folders.open_run(tmp_path / "b")
    before, names = read(tmp_path / "b"), run_folders.names(tmp_path / "b")

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", refuse)
        with pytest.raises(RunError, match="No space left"):
            finalize_recovered(tmp_path / "b", {})
    assert run_folders.names(tmp_path / "b") == names
    finalize_recovered(tmp_path / "b", {})
    assert read(tmp_path / "b").agent_steps.equals(before.agent_steps)


def test_recover_survives_damage_that_reading_refuses(tmp_path: Path) -> None:
    """Reading names the damaged file; recovering keeps the turns before the damage."""
    run_folders.open_run(tmp_path / "b", episodes=1, turns=6)
    path = tmp_path / "b" / "agent_steps-0000.arrows"
    data = bytearray(path.read_bytes())
    data[-400] ^= 1
    path.write_bytes(data)
    with pytest.raises(RunError, match=r"agent_steps-0000\.arrows"):
        read(tmp_path / "b")
    salvaged = read(tmp_path / "b", salvage=True)
    assert 0 < salvaged.agent_steps.num_rows < 14
    assert "checksum" in salvaged.cuts[0].why
    finalize_recovered(tmp_path / "b", {})
    assert salvaged.agent_steps.equals(read(tmp_path / "b").agent_steps)


def test_run_finalized_while_it_is_read_is_read_finalized(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Segments that vanish in the middle of reading don't make the run look empty."""
    env = gk.record(gk.make("two_robot_line"), tmp_path / "b")
    env.reset(seed=0)
    env.step(dict.fromkeys(env.agents, 0))

    def read_late(*arguments: Any, **options: Any) -> Any:
        env.close()
        return open_tables(*arguments, **options)

    monkeypatch.setattr("gamekeeper.runs.load_run.open_tables", read_late)
    evidence = gk.load(tmp_path / "b")
    assert evidence.manifest["status"] == "finalized"
    assert evidence.agent_steps.num_rows == 4


@given(st.data())
def test_whole_turns_are_those_of_the_plain_rule(data: st.DataObject) -> None:
    """The arithmetic over arrays equals the rule, said turn by turn."""
    ids = st.integers(0, 3)
    keys = st.lists(st.tuples(ids, st.integers(0, 4)), max_size=12)
    begun = data.draw(st.lists(ids, max_size=4))
    rows = sorted(data.draw(keys))
    acted = [data.draw(st.booleans()) for _ in rows]
    states, timings = (data.draw(st.none() | keys) for _ in range(2))
    whole = whole_turns(
        np.array(begun, np.int64),
        (*_columns(rows), np.array(acted, bool)),
        None if states is None else _columns(sorted(states)),
        None if timings is None else _columns(sorted(timings)),
    )
    found = dict(zip(whole.episodes.tolist(), whole.turns.tolist(), strict=True))
    for episode in set(begun):
        turns = 0
        while _is_whole(episode, turns, rows, states, timings):
            turns += 1
        assert turns == found[episode]
        closing = timings is not None and not any(
            acts and row == (episode, turns) for row, acts in zip(rows, acted, strict=True)
        )
        kept = whole.kept("agent_steps", *_columns(rows)) if rows else []
        for row, is_kept in zip(rows, kept, strict=True):
            if row[0] == episode:
                assert is_kept == (row[1] < turns or (row[1] == turns and closing))
    kept = whole.kept("agent_steps", *_columns(rows))
    for row, is_kept in zip(rows, kept, strict=True):
        assert not is_kept or row[0] in begun


def _is_whole(
    episode: int, turn: int, rows: list, states: list | None, timings: list | None
) -> bool:
    if not any(row[0] == episode and row[1] >= turn for row in rows):
        return False
    if timings is not None and (episode, turn) not in timings:
        return False
    if states is None or any(row[0] == episode and row[1] >= turn for row in states):
        return True
    return not any(row[0] == episode for row in states) and any(row[0] > episode for row in states)


def _columns(rows: list) -> tuple[np.ndarray, np.ndarray]:
    pairs = np.array(rows, np.int64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _is_prefix(run_files: RunFiles, whole: RunFiles) -> None:
    """Rows are the whole run's first, turns are whole, no episode has an end it didn't reach."""
    rows = run_files.agent_steps.num_rows
    assert rows == 0 or whole.agent_steps.slice(0, rows).equals(run_files.agent_steps)
    finished = [] if run_files.timings is None else run_files.timings["episode"].to_pylist()
    acted = run_files.agent_steps["order"].drop_null().length() if rows else 0
    assert len(run_folders.AGENTS) * len(finished) == acted
    for row in run_files.episodes.to_pylist():
        assert row["turns"] in (None, finished.count(row["episode"]))
