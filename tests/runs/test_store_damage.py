"""Damaged and hostile runs: an error that names the file, nothing else, and no code run."""

import json
import os
import random
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gamekeeper.errors import RunError
from gamekeeper.runs.files.checksums import commit
from gamekeeper.runs.files.folder import digest_file
from gamekeeper.runs.files.manifest import DEPTH, render
from gamekeeper.runs.files.open_streams import finalize_recovered
from gamekeeper.runs.files.parquet_tables import TableReader, write_table
from gamekeeper.runs.files.segments import SegmentReader
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import rollout
from gamekeeper.runs.untrusted import limits
from gamekeeper.runs.untrusted.limits import check_growth
from tests.runs import run_folders
from tests.runs.finalize_again import finalize_again
from tests.runs.run_folders import read


@pytest.fixture(scope="module")
def finalized(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finalized run that tests copy before they harm it."""
    return run_folders.finalized_run(
        tmp_path_factory.mktemp("finalized") / "b", episodes=1, turns=4
    )


@pytest.fixture
def copy(finalized: Path, tmp_path: Path) -> Path:
    """A copy to harm."""
    return Path(shutil.copytree(finalized, tmp_path / "b"))


def test_read_of_nothing_says_that_no_run_is_there(tmp_path: Path) -> None:
    """No folder, a file, a folder without a manifest: each is said."""
    (tmp_path / "file").write_text("x")
    for path, seen in ((tmp_path / "none", "no such folder"), (tmp_path, "without")):
        with pytest.raises(RunError, match="no run here") as caught:
            read(path)
        assert seen in caught.value.actual
    for path in (tmp_path / "file", tmp_path / "a\0b"):
        with pytest.raises(RunError):
            read(path)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b"\xff\xfe",
        b'{"format_version": 1, "status": NaN}',
        b'{"format_version": 1, "status": "open", "seed": 1e999}',
        b'{"format_version": 1}',
        b'{"format_version": 1, "status": "done"}',
        b'{"format_version": 1, "status": ["open"]}',
        b'{"format_version": 1, "status": "finalized"}',
        b'{"format_version": "1", "status": "open"}',
        b'{"format_version": true, "status": "open"}',
        b'{"format_version": 0, "status": "open"}',
        b'{"format_version": ' + b"9" * 5000 + b', "status": "open"}',
        b"[" * 100_000,
        b'{"format_version": 1, "status": "open", "a": ' + b"[" * 300 + b"]" * 300 + b"}",
    ],
)
def test_damaged_manifest_is_named(copy: Path, text: bytes) -> None:
    """No JSON, wrong types, endless nesting, numbers beyond printing: a RunError, no other."""
    (copy / "manifest.json").write_bytes(text)
    with pytest.raises(RunError) as caught:
        read(copy)
    assert "manifest" in str(caught.value)


def test_manifest_that_is_too_deep_to_check_is_refused(copy: Path) -> None:
    """What nests deeper than any space is refused before anything walks into it."""
    manifest = json.loads((copy / "manifest.json").read_text())
    for _ in range(DEPTH):
        manifest = {**manifest, "a": (manifest.get("a", {}) and [manifest["a"]]) or [[]]}
    (copy / "manifest.json").write_bytes(render(manifest))
    with pytest.raises(RunError, match="damaged"):
        read(copy)


def test_newer_format_asks_for_an_upgrade(copy: Path) -> None:
    """Both versions are named, even where all else about the manifest is new."""
    (copy / "manifest.json").write_text('{"format_version": 2, "status": "glazed"}')
    with pytest.raises(RunError, match="newer format") as caught:
        read(copy)
    assert "format_version 1" in caught.value.expected
    assert "format_version 2" in caught.value.actual
    assert "upgrade" in caught.value.fix


@pytest.mark.parametrize(
    "change",
    [
        lambda checksums: checksums.update(algorithm="md5"),
        lambda checksums: checksums.update(manifest="xyz"),
        lambda checksums: checksums.update(files=[]),
        lambda checksums: checksums["files"].update({"agent_steps.parquet": 3}),
        lambda checksums: checksums["files"]["agent_steps.parquet"].update(size="3"),
        lambda checksums: checksums["files"]["agent_steps.parquet"].update(size=-1),
        lambda checksums: checksums["files"]["agent_steps.parquet"].update(digest="Z" * 64),
        lambda checksums: checksums["files"].update(
            {"../agent_steps.parquet": checksums["files"]["agent_steps.parquet"]}
        ),
        lambda checksums: checksums["files"].update(
            {"/etc/passwd": checksums["files"]["agent_steps.parquet"]}
        ),
        lambda checksums: checksums["files"].update(
            {"C:steps": checksums["files"]["agent_steps.parquet"]}
        ),
    ],
)
def test_damaged_checksums_is_named(copy: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Checksums of another shape, or with names that lead out of the folder, is refused."""
    manifest = json.loads((copy / "manifest.json").read_text())
    change(manifest["checksums"])
    (copy / "manifest.json").write_bytes(render(manifest))
    with pytest.raises(RunError, match="manifest is damaged"):
        read(copy)


@pytest.mark.parametrize("name", ["episodes", "agent_steps", "states", "timings"])
def test_harmed_table_is_named(copy: Path, name: str) -> None:
    """A missing, cut, emptied or flipped table is named, also where checksums aren't checked."""
    path = copy / f"{name}.parquet"
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 4
    for data in (None, b"", whole[:-1], whole[: len(whole) // 2], bytes(flipped), b"PAR1" * 9):
        path.unlink()
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(RunError, match=rf"{name}\.parquet"):
            read(copy)
        with suppress(RunError):
            read(copy, check=False)
        path.write_bytes(whole)


def test_flipped_bytes_never_escape_as_other_errors(copy: Path) -> None:
    """Many random changes, read without the checksums' protection: a table or a RunError."""
    rng = random.Random(0)
    path = copy / "agent_steps.parquet"
    whole = path.read_bytes()
    refused = 0
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(rng.choice([1, 1, 2, 8])):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        try:
            TableReader(path, "agent_steps").read()
        except RunError:
            refused += 1
    assert refused > 200


def test_flipped_bytes_of_segments_are_found(tmp_path: Path) -> None:
    """A changed byte is a damage, or (in a length) a cut: never another row."""
    run_folders.open_run(tmp_path / "b", episodes=1, turns=2)
    path = tmp_path / "b" / "agent_steps-0000.arrows"
    whole = path.read_bytes()
    batches = list(SegmentReader(path, "agent_steps"))
    for place in range(0, len(whole), 3):
        data = bytearray(whole)
        data[place] ^= 1 << place % 8
        path.write_bytes(data)
        reader = SegmentReader(path, "agent_steps")
        found = []
        with suppress(RunError):
            found = list(reader)
            assert reader.cut is not None
        assert found == batches[: len(found)]


def test_unfinalized_table_beside_a_checksums_is_refused(copy: Path) -> None:
    """A table that the checksums don't name isn't read as evidence."""
    manifest = json.loads((copy / "manifest.json").read_text())
    del manifest["checksums"]["files"]["timings.parquet"]
    (copy / "manifest.json").write_bytes(render(manifest))
    with pytest.raises(RunError, match=r"timings\.parquet was changed"):
        read(copy)


def test_changed_manifest_is_refused(copy: Path) -> None:
    """A manifest that says something else than was finalized isn't read as evidence."""
    text = (copy / "manifest.json").read_text()
    (copy / "manifest.json").write_text(text.replace('"demo"', '"omed"'))
    with pytest.raises(RunError, match=r"manifest\.json was changed"):
        read(copy)


@pytest.mark.parametrize("name", ["agent_steps.parquet", "manifest.json"])
def test_links_and_pipes_are_not_followed(copy: Path, name: str, tmp_path: Path) -> None:
    """A link out of the folder and a pipe (which would be waited for) are refused."""
    outside = tmp_path / "outside"
    (copy / name).rename(outside)
    (copy / name).symlink_to(outside)
    with pytest.raises(RunError):
        read(copy, check=False)
    (copy / name).unlink()
    os.mkfifo(copy / name)
    with pytest.raises(RunError, match="not a plain file"):
        read(copy, check=False)
    (copy / name).unlink()
    (copy / name).mkdir()
    with pytest.raises(RunError):
        read(copy, check=False)


def test_linked_segments_are_not_followed(tmp_path: Path) -> None:
    """The same holds for the segments of an open run."""
    run_folders.open_run(tmp_path / "b", episodes=1)
    segment = tmp_path / "b" / "agent_steps-0000.arrows"
    segment.rename(tmp_path / "outside")
    segment.symlink_to(tmp_path / "outside")
    with pytest.raises(RunError, match="link"):
        read(tmp_path / "b")


def test_extension_types_are_refused_before_they_are_made(tmp_path: Path) -> None:
    """A type registered by some package never gets to run its code while a run is read."""
    made = []

    class Spy(pa.ExtensionType):
        def __init__(self) -> None:
            super().__init__(pa.int64(), "tests.spy")

        def __arrow_ext_serialize__(self) -> bytes:
            return b""

        @classmethod
        def __arrow_ext_deserialize__(cls, storage: pa.DataType, data: bytes) -> "Spy":
            made.append(storage)
            return cls()

    keys = {name: pa.array([0], pa.int32()) for name in ("episode", "turn")}
    table = pa.table({**keys, "x": pa.ExtensionArray.from_storage(Spy(), pa.array([1]))})
    pa.register_extension_type(Spy())
    try:
        pq.write_table(table, tmp_path / "agent_steps.parquet")
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, table.schema) as writer:
            writer.write_table(table)
        (tmp_path / "agent_steps-0000.arrows").write_bytes(sink.getvalue())
        made.clear()
        with pytest.raises(RunError, match="extension"):
            TableReader(tmp_path / "agent_steps.parquet", "agent_steps")
        with pytest.raises(RunError, match="extension"):
            list(SegmentReader(tmp_path / "agent_steps-0000.arrows", "agent_steps"))
    finally:
        pa.unregister_extension_type("tests.spy")
    assert made == []


def test_dictionary_that_stands_for_terabytes_is_refused(tmp_path: Path) -> None:
    """Ten kilobytes that unpack to a terabyte of text are refused before memory is taken."""
    rows = 1 << 20
    zeros = pa.array([0] * rows, pa.int32())
    agent = pa.DictionaryArray.from_arrays(zeros, pa.array(["x" * (1 << 20)]))
    table = pa.table({"episode": zeros, "turn": zeros, "agent": agent})
    path = tmp_path / "agent_steps.parquet"
    pq.write_table(table, path, compression="zstd", dictionary_pagesize_limit=1 << 24)
    assert path.stat().st_size < 20_000
    with pytest.raises(RunError, match="unpack to more than"):
        TableReader(path, "agent_steps").read()


def test_batch_that_stands_for_gigabytes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a batch announces is added up before it is unpacked."""
    run_folders.open_run(tmp_path / "b", episodes=1)
    path = tmp_path / "b" / "agent_steps-0000.arrows"
    assert len(list(SegmentReader(path, "agent_steps"))) == 4
    monkeypatch.setattr(limits, "BATCH_BYTES", 100)
    monkeypatch.setattr(limits, "GROWTH", 0)
    with pytest.raises(RunError, match="unpack to more than 100"):
        list(SegmentReader(path, "agent_steps"))


@pytest.mark.parametrize("make", [run_folders.open_run, run_folders.finalized_run])
def test_table_larger_than_memory_is_refused(
    tmp_path: Path, make: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many honest batches can be more than the machine holds; they can still be read in part."""
    make(tmp_path / "b", episodes=50)
    monkeypatch.setattr(limits, "memory_bytes", lambda: 10_000)
    with pytest.raises(RunError, match="a machine with 10000"):
        read(tmp_path / "b")


def test_finalizing_needs_less_memory_than_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is too large to be read at once is finalized and recovered batch by batch."""
    run_folders.open_run(tmp_path / "b", episodes=20)
    with monkeypatch.context() as patch:
        patch.setattr(limits, "memory_bytes", lambda: 5_000)
        finalize_recovered(tmp_path / "b", {})
    assert read(tmp_path / "b").agent_steps.num_rows == 280


def test_honest_growth_is_let_pass() -> None:
    """Four gigabytes are fine for any batch, a thousandfold for large ones."""
    check_growth(limits.BATCH_BYTES, 1)
    check_growth(10 * limits.BATCH_BYTES, limits.BATCH_BYTES // 50)
    with pytest.raises(ValueError, match="unpack"):
        check_growth(2 * limits.BATCH_BYTES, 1000)
    assert limits.memory_bytes() > 1 << 20


def test_table_with_other_columns_is_refused(tmp_path: Path) -> None:
    """A table under checksums of its own that isn't a run's is refused all the same."""
    (tmp_path / "b").mkdir()
    schema = pa.schema([("turn", pa.int32())])
    files = {"agent_steps": write_table(tmp_path / "b", "agent_steps", schema, [])}
    commit(tmp_path / "b", {"format_version": 1, "status": "finalized"}, files)
    with pytest.raises(RunError, match="columns that a run doesn't hold"):
        read(tmp_path / "b")


@pytest.mark.parametrize(
    ("stream", "column", "other"),
    [
        ("episodes", "endings", None),
        ("agent_steps", "reward", pa.string()),
        ("timings", "wall_ns", pa.string()),
    ],
)
def test_table_without_a_column_that_readers_need_is_refused(
    tmp_path: Path, stream: str, column: str, other: pa.DataType | None
) -> None:
    """A run whose table lacks a column, or has it with another type, is refused by name."""
    run = tmp_path / "run"
    rollout("two_robot_line", episodes=1, out=run)
    table = pq.read_table(run / f"{stream}.parquet")
    place = table.schema.get_field_index(column)
    changed = table.remove_column(place)
    if other is not None:
        changed = changed.add_column(place, column, table[column].cast(other))
    pq.write_table(changed, run / f"{stream}.parquet")
    size, digest = digest_file(run / f"{stream}.parquet")
    checksums = json.loads((run / "manifest.json").read_text(encoding="utf-8"))["checksums"]
    checksums["files"][f"{stream}.parquet"] = {"digest": digest, "size": size}
    finalize_again(run, checksums=checksums)
    with pytest.raises(RunError, match=rf"columns that a run doesn't hold.*\n.*{column}"):
        load(run)


def test_stream_that_claims_to_be_small_keeps_its_columns(tmp_path: Path) -> None:
    """Only episodes and rows leave columns out at level actions, whatever a file says."""
    names = ["episode", "turn", "state"]
    schema = pa.schema([(name, pa.int32()) for name in names], metadata={"level": "actions"})
    table = pa.table([pa.array([0], pa.int32())] * 3, schema=schema)
    pq.write_table(table, tmp_path / "states.parquet")
    assert TableReader(tmp_path / "states.parquet", "states").schema.names == names
