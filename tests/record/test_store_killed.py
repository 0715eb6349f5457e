"""What is left of a run whose process died, and how it is sealed."""

import errno
import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import BundleError
from gamekeeper.record.files import seal as seal_module
from gamekeeper.record.files.seal import check_seal
from gamekeeper.record.files.segment_reader import SegmentReader
from gamekeeper.record.files.segment_writer import SegmentWriter
from gamekeeper.record.files.store import Bundle, Store, read, seal_recovered
from gamekeeper.record.files.whole import whole_turns
from tests.record import bundles

APPENDING = """
import os, sys
from gamekeeper.record.files.store import Store
from tests.record import bundles
store = Store.create(sys.argv[1], {}, segment_bytes=int(sys.argv[2]))
store.append("episodes", bundles.begin(0))
for turn in range(1_000_000):
    store.append("steps", bundles.steps(0, turn, turn + 1))
    store.append("timings", bundles.timings(0, turn, turn + 1))
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
    bundle = read(tmp_path / "b")
    kept = bundle.steps.num_rows // len(bundles.AGENTS)
    assert appended <= kept <= appended + 1
    seal_recovered(tmp_path / "b", {})
    assert bundle.steps.equals(read(tmp_path / "b").steps)
    assert check_seal(tmp_path / "b") == ()


def test_segment_cut_at_any_byte_gives_its_whole_batches(tmp_path: Path) -> None:
    """A file that ends anywhere reads without an error; each batch is there once its bytes are."""
    path = tmp_path / "timings-0000.arrows"
    writer = SegmentWriter(path, bundles.timings(0, 0, 1).schema)
    sizes = []
    for turn in range(2):
        writer.write(bundles.timings(0, turn, turn + 1))
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


@pytest.mark.parametrize("stream", ["episodes", "steps", "states", "timings"])
def test_torn_segment_keeps_whole_turns(tmp_path: Path, stream: str) -> None:
    """Wherever a stream is cut: the more of it, the more turns are kept, and never half a turn."""
    whole = read(bundles.open_bundle(tmp_path / "b", episodes=2, turns=4))
    path = tmp_path / "b" / f"{stream}-0000.arrows"
    data = path.read_bytes()
    counts = []
    for size in [*range(0, len(data), 211), len(data)]:
        path.write_bytes(data[:size])
        bundle = read(tmp_path / "b")
        _is_prefix(bundle, whole)
        counts.append(bundle.steps.num_rows)
    assert sorted(counts) == counts
    assert whole.steps.num_rows == counts[-1]
    path.write_bytes(data[:-1])
    assert f"{stream}-0000.arrows" == read(tmp_path / "b").cuts[0].file


@given(st.data())
@settings(max_examples=25)
def test_streams_cut_anywhere_agree(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """With every stream cut somewhere else, what is kept fits together, and recovers the same."""
    path = bundles.open_bundle(tmp_path_factory.mktemp("cut") / "b", episodes=3, turns=4)
    for stream in ("episodes", "steps", "states", "timings"):
        segment = path / f"{stream}-0000.arrows"
        part = data.draw(st.floats(0, 1), label=stream)
        segment.write_bytes(segment.read_bytes()[: int(part * segment.stat().st_size)])
    bundle = read(path)
    finished = _turns_of(bundle.timings)
    acted = bundle.steps
    if len(acted):
        acted = acted.filter(acted["order"].is_valid())
    assert _turns_of(acted) == finished
    assert finished <= _turns_of(bundle.states)
    begun = set(bundle.episodes["episode"].to_pylist())
    assert {episode for episode, _ in _turns_of(bundle.steps)} <= begun
    for row in bundle.episodes.to_pylist():
        assert row["turns"] in (None, sum(episode == row["episode"] for episode, _ in finished))
    seal_recovered(path, {})
    again = read(path)
    assert again.steps.to_pylist() == bundle.steps.to_pylist()
    assert again.episodes.to_pylist() == bundle.episodes.to_pylist()


def _turns_of(table: pa.Table | None) -> set[tuple[int, int]]:
    if table is None:
        return set()
    return set(zip(table["episode"].to_pylist(), table["turn"].to_pylist(), strict=True))


def test_bundle_reads_while_it_is_recorded(tmp_path: Path) -> None:
    """Each look at a growing bundle sees whole turns, and never fewer than the look before."""
    store = Store.create(tmp_path / "b", {}, segment_bytes=20_000)
    done = threading.Event()

    def record() -> None:
        bundles.fill(store, episodes=4, turns=20)
        done.set()

    recorder = threading.Thread(target=record)
    recorder.start()
    seen = [0]
    while not done.is_set():
        bundle = read(tmp_path / "b")
        if bundle.timings is None:  # its first file comes after the first rows: nothing to compare
            continue
        finished = bundle.timings.num_rows
        acted = bundle.steps["order"].drop_null().length() if len(bundle.steps) else 0
        assert acted == finished * len(bundles.AGENTS)
        seen.append(finished)
    recorder.join()
    store.seal({})
    assert sorted(seen) == seen
    assert len(_turns_of(read(tmp_path / "b").timings)) == 80


def test_missing_end_of_a_middle_segment_ends_the_stream(tmp_path: Path) -> None:
    """Segments after a cut one don't count: there would be a hole before them."""
    store = Store.create(tmp_path / "b", {}, segment_bytes=1)
    bundles.fill(store, episodes=1, turns=6)
    store.abandon()
    path = tmp_path / "b" / "steps-0001.arrows"
    path.write_bytes(path.read_bytes()[:-20])
    bundle = read(tmp_path / "b")
    assert bundle.steps["turn"].to_pylist() == [0, 0, 1, 1]
    assert any("later segments" in cut.why for cut in bundle.cuts)
    (tmp_path / "b" / "steps-0000.arrows").unlink()
    with pytest.raises(BundleError, match=r"steps-0000\.arrows is missing"):
        read(tmp_path / "b")
    bundle = read(tmp_path / "b", salvage=True)
    assert bundle.steps.num_rows == 0
    assert [cut.why for cut in bundle.cuts] == ["the segment is missing"]


@pytest.mark.parametrize("step", range(9))
def test_killed_while_sealing_the_bundle_still_reads(
    tmp_path: Path, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wherever sealing stops, what is read is the same, and recovering finishes it."""
    bundles.sealed_bundle(tmp_path / "whole")
    store = Store.create(tmp_path / "b", {})
    bundles.fill(store)
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
        manifest = {"status": "sealed", "format_version": 1}
        with suppress(Killed):
            seal_module.commit(tmp_path / "b", manifest, drafts)
    expected, bundle = read(tmp_path / "whole"), read(tmp_path / "b")
    for name in ("episodes", "steps", "states", "timings"):
        assert getattr(expected, name).equals(getattr(bundle, name)), name
    store._close()
    if not bundle.sealed:
        seal_recovered(tmp_path / "b", {})
    assert expected.steps.equals(read(tmp_path / "b").steps)
    assert check_seal(tmp_path / "b") == ()


def _drafts(store: Store) -> dict[str, tuple[Path, int, str]]:
    """What sealing has written just before it gives the files their names."""
    found: dict[str, tuple[Path, int, str]] = {}
    original = seal_module.commit
    module = sys.modules["gamekeeper.record.files.store"]
    try:
        module.commit = lambda _folder, _manifest, files, **_: found.update(files)  # type: ignore  # for this play alone
        store._seal({})
    finally:
        module.commit = original  # type: ignore
    return found


def test_recover_seals_what_read_gives(tmp_path: Path) -> None:
    """Recovering keeps the whole turns, drops the unfinished one, and says where files were cut."""
    bundles.open_bundle(tmp_path / "b", episodes=2, turns=6)
    for stream, size in (("steps", 100), ("timings", 0)):
        path = tmp_path / "b" / f"{stream}-0000.arrows"
        path.write_bytes(path.read_bytes()[: -1 - size])
    before = read(tmp_path / "b")
    cuts = seal_recovered(tmp_path / "b", {"name": "demo"})
    after = read(tmp_path / "b")
    assert {"steps-0000.arrows", "timings-0000.arrows"} == {cut.file for cut in cuts}
    assert after.manifest["status"] == "recovered"
    for name in ("episodes", "steps", "states", "timings"):
        assert getattr(before, name).equals(getattr(after, name)), name
    assert after.episodes["end"].to_pylist() == ["ended", None]
    assert not list((tmp_path / "b").glob("*.arrows"))


def test_recover_takes_other_rows_of_episodes(tmp_path: Path) -> None:
    """Whoever recovers may say how each episode ended."""
    bundles.open_bundle(tmp_path / "b", episodes=1)
    rows = pa.table({"episode": pa.array([0], pa.int32()), "end": ["torn"]})
    seal_recovered(tmp_path / "b", {}, episodes=rows)
    assert read(tmp_path / "b").episodes["end"].to_pylist() == ["torn"]


def test_recover_refuses_what_is_not_dead(tmp_path: Path) -> None:
    """A sealed bundle, one that is being recorded, and no bundle at all are left alone."""
    bundles.sealed_bundle(tmp_path / "sealed")
    with pytest.raises(BundleError, match="sealed already"):
        seal_recovered(tmp_path / "sealed", {})
    store = Store.create(tmp_path / "live", {})
    with pytest.raises(BundleError, match="being recorded"):
        seal_recovered(tmp_path / "live", {})
    store.abandon()
    seal_recovered(tmp_path / "live", {})
    with pytest.raises(BundleError):
        seal_recovered(tmp_path / "none", {})


def test_recover_on_a_full_disk_leaves_the_run_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing half-made stays behind, and recovering again, with space, works."""
    bundles.open_bundle(tmp_path / "b")
    before, names = read(tmp_path / "b"), bundles.names(tmp_path / "b")

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", refuse)
        with pytest.raises(BundleError, match="No space left"):
            seal_recovered(tmp_path / "b", {})
    assert bundles.names(tmp_path / "b") == names
    seal_recovered(tmp_path / "b", {})
    assert read(tmp_path / "b").steps.equals(before.steps)


def test_recover_survives_damage_that_reading_refuses(tmp_path: Path) -> None:
    """Reading names the damaged file; recovering keeps the turns before the damage."""
    bundles.open_bundle(tmp_path / "b", episodes=1, turns=6)
    path = tmp_path / "b" / "steps-0000.arrows"
    data = bytearray(path.read_bytes())
    data[-400] ^= 1
    path.write_bytes(data)
    with pytest.raises(BundleError, match=r"steps-0000\.arrows"):
        read(tmp_path / "b")
    salvaged = read(tmp_path / "b", salvage=True)
    assert 0 < salvaged.steps.num_rows < 14
    assert "checksum" in salvaged.cuts[0].why
    seal_recovered(tmp_path / "b", {})
    assert salvaged.steps.equals(read(tmp_path / "b").steps)


def test_bundle_sealed_while_it_is_read_is_read_sealed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Segments that vanish in the middle of reading don't make the run look empty."""
    store = Store.create(tmp_path / "b", {})
    bundles.fill(store)
    module = sys.modules["gamekeeper.record.files.reading"]
    original = module._read_open

    def read_late(*arguments: object, **options: object) -> Bundle:
        store.seal({})
        return original(*arguments, **options)

    monkeypatch.setattr(module, "_read_open", read_late)
    bundle = read(tmp_path / "b")
    assert bundle.sealed
    assert bundle.steps.num_rows == 28


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
        kept = whole.steps(*_columns(rows)) if rows else []
        for row, is_kept in zip(rows, kept, strict=True):
            if row[0] == episode:
                assert is_kept == (row[1] < turns or (row[1] == turns and closing))
    for row, is_kept in zip(rows, whole.steps(*_columns(rows)), strict=True):
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


def _is_prefix(bundle: Bundle, whole: Bundle) -> None:
    """Rows are the whole run's first, turns are whole, no episode has an end it didn't reach."""
    rows = bundle.steps.num_rows
    assert rows == 0 or whole.steps.slice(0, rows).equals(bundle.steps)
    finished = [] if bundle.timings is None else bundle.timings["episode"].to_pylist()
    acted = bundle.steps["order"].drop_null().length() if rows else 0
    assert len(bundles.AGENTS) * len(finished) == acted
    for row in bundle.episodes.to_pylist():
        assert row["turns"] in (None, finished.count(row["episode"]))
