"""Damaged and hostile bundles: an error that names the file, nothing else, and no code run."""

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

from gamekeeper.errors import BundleError
from gamekeeper.record.bundle import load
from gamekeeper.record.files import limits
from gamekeeper.record.files.folder import digest_file
from gamekeeper.record.files.limits import check_growth
from gamekeeper.record.files.manifest import DEPTH, render
from gamekeeper.record.files.seal import commit
from gamekeeper.record.files.segment_reader import SegmentReader
from gamekeeper.record.files.store import read, seal_recovered
from gamekeeper.record.files.table_reader import TableReader
from gamekeeper.record.files.table_writer import write_table
from gamekeeper.record.recording import rollout
from tests.record import bundles
from tests.record.reseal import reseal


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sealed bundle that tests copy before they harm it."""
    return bundles.sealed_bundle(tmp_path_factory.mktemp("sealed") / "b", episodes=1, turns=4)


@pytest.fixture
def copy(sealed: Path, tmp_path: Path) -> Path:
    """A copy to harm."""
    return Path(shutil.copytree(sealed, tmp_path / "b"))


def test_read_of_nothing_says_that_no_bundle_is_there(tmp_path: Path) -> None:
    """No folder, a file, a folder without a manifest: each is said."""
    (tmp_path / "file").write_text("x")
    for path, seen in ((tmp_path / "none", "no such folder"), (tmp_path, "without")):
        with pytest.raises(BundleError, match="no bundle here") as caught:
            read(path)
        assert seen in caught.value.seen
    for path in (tmp_path / "file", tmp_path / "a\0b"):
        with pytest.raises(BundleError):
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
        b'{"format_version": 1, "status": "sealed"}',
        b'{"format_version": "1", "status": "open"}',
        b'{"format_version": true, "status": "open"}',
        b'{"format_version": 0, "status": "open"}',
        b'{"format_version": ' + b"9" * 5000 + b', "status": "open"}',
        b"[" * 100_000,
        b'{"format_version": 1, "status": "open", "a": ' + b"[" * 300 + b"]" * 300 + b"}",
    ],
)
def test_damaged_manifest_is_named(copy: Path, text: bytes) -> None:
    """No JSON, wrong types, endless nesting, numbers beyond printing: a BundleError, no other."""
    (copy / "manifest.json").write_bytes(text)
    with pytest.raises(BundleError) as caught:
        read(copy)
    assert "manifest" in str(caught.value)


def test_manifest_that_is_too_deep_to_check_is_refused(copy: Path) -> None:
    """What nests deeper than any space is refused before anything walks into it."""
    manifest = json.loads((copy / "manifest.json").read_text())
    for _ in range(DEPTH):
        manifest = {**manifest, "a": (manifest.get("a", {}) and [manifest["a"]]) or [[]]}
    (copy / "manifest.json").write_bytes(render(manifest))
    with pytest.raises(BundleError, match="damaged"):
        read(copy)


def test_newer_format_asks_for_an_upgrade(copy: Path) -> None:
    """Both versions are named, even where all else about the manifest is new."""
    (copy / "manifest.json").write_text('{"format_version": 2, "status": "glazed"}')
    with pytest.raises(BundleError, match="newer format") as caught:
        read(copy)
    assert "format_version 1" in caught.value.expected
    assert "format_version 2" in caught.value.seen
    assert "upgrade" in caught.value.mend


@pytest.mark.parametrize(
    "change",
    [
        lambda seal: seal.update(algorithm="md5"),
        lambda seal: seal.update(manifest="xyz"),
        lambda seal: seal.update(files=[]),
        lambda seal: seal["files"].update({"steps.parquet": 3}),
        lambda seal: seal["files"]["steps.parquet"].update(size="3"),
        lambda seal: seal["files"]["steps.parquet"].update(size=-1),
        lambda seal: seal["files"]["steps.parquet"].update(digest="Z" * 64),
        lambda seal: seal["files"].update({"../steps.parquet": seal["files"]["steps.parquet"]}),
        lambda seal: seal["files"].update({"/etc/passwd": seal["files"]["steps.parquet"]}),
        lambda seal: seal["files"].update({"C:steps": seal["files"]["steps.parquet"]}),
    ],
)
def test_damaged_seal_is_named(copy: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """A seal of another shape, or with names that lead out of the folder, is refused."""
    manifest = json.loads((copy / "manifest.json").read_text())
    change(manifest["seal"])
    (copy / "manifest.json").write_bytes(render(manifest))
    with pytest.raises(BundleError, match="manifest is damaged"):
        read(copy)


@pytest.mark.parametrize("name", ["episodes", "steps", "states", "timings"])
def test_harmed_table_is_named(copy: Path, name: str) -> None:
    """A missing, cut, emptied or flipped table is named, also where the seal isn't checked."""
    path = copy / f"{name}.parquet"
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 4
    for data in (None, b"", whole[:-1], whole[: len(whole) // 2], bytes(flipped), b"PAR1" * 9):
        path.unlink()
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(BundleError, match=rf"{name}\.parquet"):
            read(copy)
        with suppress(BundleError):
            read(copy, check=False)
        path.write_bytes(whole)


def test_flipped_bytes_never_escape_as_other_errors(copy: Path) -> None:
    """Hundreds of random changes, read without the seal's protection: a table or a BundleError."""
    rng = random.Random(0)
    path = copy / "steps.parquet"
    whole = path.read_bytes()
    refused = 0
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(rng.choice([1, 1, 2, 8])):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        try:
            TableReader(path, "steps").read()
        except BundleError:
            refused += 1
    assert refused > 200


def test_flipped_bytes_of_segments_are_found(tmp_path: Path) -> None:
    """A changed byte is a damage, or (in a length) a cut: never another row."""
    bundles.open_bundle(tmp_path / "b", episodes=1, turns=2)
    path = tmp_path / "b" / "steps-0000.arrows"
    whole = path.read_bytes()
    batches = list(SegmentReader(path, "steps"))
    for place in range(0, len(whole), 3):
        data = bytearray(whole)
        data[place] ^= 1 << place % 8
        path.write_bytes(data)
        reader = SegmentReader(path, "steps")
        found = []
        with suppress(BundleError):
            found = list(reader)
            assert reader.cut is not None
        assert found == batches[: len(found)]


def test_unsealed_table_beside_a_seal_is_refused(copy: Path) -> None:
    """A table that the seal doesn't name isn't read as evidence."""
    manifest = json.loads((copy / "manifest.json").read_text())
    del manifest["seal"]["files"]["timings.parquet"]
    (copy / "manifest.json").write_bytes(render(manifest))
    with pytest.raises(BundleError, match=r"timings\.parquet was changed"):
        read(copy)


def test_changed_manifest_is_refused(copy: Path) -> None:
    """A manifest that says something else than was sealed isn't read as evidence."""
    text = (copy / "manifest.json").read_text()
    (copy / "manifest.json").write_text(text.replace('"demo"', '"omed"'))
    with pytest.raises(BundleError, match=r"manifest\.json was changed"):
        read(copy)


@pytest.mark.parametrize("name", ["steps.parquet", "manifest.json"])
def test_links_and_pipes_are_not_followed(copy: Path, name: str, tmp_path: Path) -> None:
    """A link out of the folder and a pipe (which would be waited for) are refused."""
    outside = tmp_path / "outside"
    (copy / name).rename(outside)
    (copy / name).symlink_to(outside)
    with pytest.raises(BundleError):
        read(copy, check=False)
    (copy / name).unlink()
    os.mkfifo(copy / name)
    with pytest.raises(BundleError, match="not a plain file"):
        read(copy, check=False)
    (copy / name).unlink()
    (copy / name).mkdir()
    with pytest.raises(BundleError):
        read(copy, check=False)


def test_linked_segments_are_not_followed(tmp_path: Path) -> None:
    """The same holds for the segments of an open bundle."""
    bundles.open_bundle(tmp_path / "b", episodes=1)
    segment = tmp_path / "b" / "steps-0000.arrows"
    segment.rename(tmp_path / "outside")
    segment.symlink_to(tmp_path / "outside")
    with pytest.raises(BundleError, match="link"):
        read(tmp_path / "b")


def test_extension_types_are_refused_before_they_are_made(tmp_path: Path) -> None:
    """A type registered by some package never gets to run its code while a bundle is read."""
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
        pq.write_table(table, tmp_path / "steps.parquet")
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, table.schema) as writer:
            writer.write_table(table)
        (tmp_path / "steps-0000.arrows").write_bytes(sink.getvalue())
        made.clear()
        with pytest.raises(BundleError, match="extension"):
            TableReader(tmp_path / "steps.parquet", "steps")
        with pytest.raises(BundleError, match="extension"):
            list(SegmentReader(tmp_path / "steps-0000.arrows", "steps"))
    finally:
        pa.unregister_extension_type("tests.spy")
    assert made == []


def test_dictionary_that_stands_for_terabytes_is_refused(tmp_path: Path) -> None:
    """Ten kilobytes that unpack to a terabyte of text are refused before memory is taken."""
    rows = 1 << 20
    zeros = pa.array([0] * rows, pa.int32())
    agent = pa.DictionaryArray.from_arrays(zeros, pa.array(["x" * (1 << 20)]))
    table = pa.table({"episode": zeros, "turn": zeros, "agent": agent})
    path = tmp_path / "steps.parquet"
    pq.write_table(table, path, compression="zstd", dictionary_pagesize_limit=1 << 24)
    assert path.stat().st_size < 20_000
    with pytest.raises(BundleError, match="unpack to more than"):
        TableReader(path, "steps").read()


def test_batch_that_stands_for_gigabytes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a batch announces is added up before it is unpacked."""
    bundles.open_bundle(tmp_path / "b", episodes=1)
    path = tmp_path / "b" / "steps-0000.arrows"
    assert len(list(SegmentReader(path, "steps"))) == 4
    monkeypatch.setattr(limits, "BATCH_BYTES", 100)
    monkeypatch.setattr(limits, "GROWTH", 0)
    with pytest.raises(BundleError, match="unpack to more than 100"):
        list(SegmentReader(path, "steps"))


@pytest.mark.parametrize("make", [bundles.open_bundle, bundles.sealed_bundle])
def test_table_larger_than_memory_is_refused(
    tmp_path: Path, make: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many honest batches can be more than the machine holds; they can still be read in part."""
    make(tmp_path / "b", episodes=50)
    monkeypatch.setattr(limits, "memory_bytes", lambda: 10_000)
    with pytest.raises(BundleError, match="a machine with 10000"):
        read(tmp_path / "b")


def test_sealing_needs_less_memory_than_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is too large to be read at once is sealed and recovered batch by batch."""
    bundles.open_bundle(tmp_path / "b", episodes=20)
    with monkeypatch.context() as patch:
        patch.setattr(limits, "memory_bytes", lambda: 5_000)
        seal_recovered(tmp_path / "b", {})
    assert read(tmp_path / "b").steps.num_rows == 280


def test_honest_growth_is_let_pass() -> None:
    """Four gigabytes are fine for any batch, a thousandfold for large ones."""
    check_growth(limits.BATCH_BYTES, 1)
    check_growth(10 * limits.BATCH_BYTES, limits.BATCH_BYTES // 50)
    with pytest.raises(ValueError, match="unpack"):
        check_growth(2 * limits.BATCH_BYTES, 1000)
    assert limits.memory_bytes() > 1 << 20


def test_table_with_other_columns_is_refused(tmp_path: Path) -> None:
    """A table under a seal of its own that isn't a bundle's is refused all the same."""
    (tmp_path / "b").mkdir()
    schema = pa.schema([("turn", pa.int32())])
    files = {"steps": write_table(tmp_path / "b", "steps", schema, [])}
    commit(tmp_path / "b", {"format_version": 1, "status": "sealed"}, files)
    with pytest.raises(BundleError, match="columns that a bundle doesn't hold"):
        read(tmp_path / "b")


@pytest.mark.parametrize(
    ("stream", "column", "other"),
    [
        ("episodes", "endings", None),
        ("steps", "reward", pa.string()),
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
    seal = json.loads((run / "manifest.json").read_text(encoding="utf-8"))["seal"]
    seal["files"][f"{stream}.parquet"] = {"digest": digest, "size": size}
    reseal(run, seal=seal)
    with pytest.raises(BundleError, match=rf"columns that a bundle doesn't hold.*\n.*{column}"):
        load(run)
