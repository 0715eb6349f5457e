from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gamekeeper.errors import BundleError
from gamekeeper.record.bundle import load
from gamekeeper.record.files.folder import digest_file
from gamekeeper.record.recorder import Recorder
from gamekeeper.record.verify import digest_again, verify
from tests.record.plays import played
from tests.record.reseal import reseal

FILES = ("episodes.parquet", "manifest.json", "states.parquet", "steps.parquet", "timings.parquet")


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small sealed bundle, for tests that leave it as it was."""
    folder = tmp_path_factory.mktemp("verify")
    played(folder, episodes=1, env_kwargs={"turns": 1})
    return folder / "run"


@pytest.mark.parametrize("env", ["Walk", "Turns"])
@pytest.mark.parametrize("level", ["full", "digest"])
def test_verify_finds_a_bundle_self_consistent(tmp_path: Path, env: str, level: str) -> None:
    """A bundle that nobody touched digests to its fingerprint."""
    evidence = played(tmp_path, env=env, level=level)

    found = verify(tmp_path / "run")

    assert found.ok, str(found)
    assert (found.self_consistent, found.matches, found.damage) == (True, None, ())
    assert evidence.fingerprint == found.fingerprint
    assert f"self-consistent\nfingerprint {evidence.fingerprint}" == str(found)


@pytest.mark.parametrize("digits", [8, 20, 64])
def test_verify_compares_with_a_fingerprint_from_elsewhere(sealed: Path, digits: int) -> None:
    """The first digits of the right one match, in capitals too; another doesn't, nor do too few."""
    right = load(sealed).fingerprint[:digits]
    wrong = right[:-1] + ("0" if right[-1] != "0" else "1")

    assert verify(sealed, fingerprint=f" {right.upper()}\n").ok
    found = verify(sealed, fingerprint=wrong)
    assert (found.self_consistent, found.matches, found.ok) == (True, False, False)
    assert not verify(sealed, fingerprint=right[:7]).ok
    assert found.to_json()["matches"] is False


def test_verify_finds_changed_bytes_of_the_manifest(sealed: Path) -> None:
    """Whatever byte of the manifest is flipped, verify says damage, and raises nothing."""
    path = sealed / "manifest.json"
    data = path.read_bytes()
    try:
        for place in range(0, len(data), 4):
            path.write_bytes(flipped(data, place, 1 if place % 8 else 0x80))
            assert was_damaged(sealed), (place, data[place - 20 : place + 20])
    finally:
        path.write_bytes(data)


def flipped(data: bytes, place: int, bits: int) -> bytes:
    """The bytes with one of them changed."""
    return data[:place] + bytes([data[place] ^ bits]) + data[place + 1 :]


def was_damaged(run: Path) -> set[str]:
    """The files that verify finds damaged; a version that nobody wrote yet is refused instead."""
    try:
        found = verify(run)
    except BundleError as error:
        return {"manifest.json"} if "newer format" in str(error) else set()
    return set() if found.ok else {each.file for each in found.damage}


@settings(
    max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(data=st.data())
def test_verify_finds_changed_bytes_of_every_file(sealed: Path, data: st.DataObject) -> None:
    """A flipped byte, a cut and an appended byte are found in any file, and the file is named."""
    name = data.draw(st.sampled_from(FILES))
    whole = (sealed / name).read_bytes()
    place = data.draw(st.integers(0, len(whole) - 1))
    other = flipped(whole, place, data.draw(st.integers(1, 255)))
    changed = data.draw(st.sampled_from([other, whole[:place], whole + b"\n"]))
    try:
        (sealed / name).write_bytes(changed)
        assert name in was_damaged(sealed)
    finally:
        (sealed / name).write_bytes(whole)


def test_verify_names_files_that_are_missing_or_extra(tmp_path: Path) -> None:
    """A table that is gone, a frame that was added, and broken annotations are each named."""
    played(tmp_path, episodes=1)
    run = tmp_path / "run"
    (run / "timings.parquet").unlink()
    (run / "frames").mkdir()
    (run / "frames" / "0.png").write_bytes(b"")
    (run / "annotations.jsonl").write_text("{}\n", encoding="utf-8")

    found = {(each.file, each.what) for each in verify(run).damage}

    assert found == {
        ("timings.parquet", "missing"),
        ("frames/0.png", "extra"),
        ("annotations.jsonl", "changed"),
    }


@pytest.mark.parametrize("column", ["reward", "obs", "info", "agent"])
def test_verify_finds_rows_that_were_sealed_again(tmp_path: Path, column: str) -> None:
    """Who changes a row and seals it again is found by the fingerprint of its episode."""
    played(tmp_path)
    path = tmp_path / "run" / "steps.parquet"
    table = pq.read_table(path)
    place = table.schema.get_field_index(column)
    values = table[column].to_pylist()
    row = next(row for row, value in enumerate(values) if value and value != values[0])
    values[0] = values[row]
    field = table.schema.field(place)
    changed = table.set_column(place, field, pa.array(values, field.type))
    pq.write_table(changed, path)
    size, digest = digest_file(path)
    seal = dict(load(tmp_path / "run", check=False).manifest["seal"])
    seal["files"]["steps.parquet"] = {"size": size, "digest": digest}
    reseal(tmp_path / "run", seal=seal)

    found = verify(tmp_path / "run")

    assert not found.ok
    assert not found.self_consistent
    assert "episode 0 doesn't digest to its fingerprint" in str(found)


def test_verify_finds_a_fingerprint_that_was_sealed_again(tmp_path: Path) -> None:
    """A manifest that names another fingerprint contradicts its rows."""
    played(tmp_path, episodes=1)
    reseal(tmp_path / "run", fingerprint="f" * 64)

    found = verify(tmp_path / "run", fingerprint="f" * 64)

    assert (found.self_consistent, found.matches, found.damage) == (False, False, ())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("environment", None),
        ("environment", []),
        ("spaces", {"a": 3}),
        ("spaces", None),
        ("contract", {"rewards": 3}),
        ("contract", "x"),
        ("terms", 7),
        ("agents", None),
    ],
)
def test_verify_reads_hostile_manifests(tmp_path: Path, key: str, value: object) -> None:
    """What no recorder wrote isn't consistent, or doesn't matter to the rows; nothing crashes."""
    played(tmp_path, episodes=1)
    reseal(tmp_path / "run", **{key: value})

    found = verify(tmp_path / "run")

    assert not found.ok or key in ("terms", "agents")


def test_verify_refuses_what_was_never_sealed(tmp_path: Path) -> None:
    """A run that is still recorded has no seal to compare with; no bundle has none at all."""
    recorder = Recorder(tmp_path / "run", environment={})

    with pytest.raises(BundleError, match="never sealed"):
        verify(tmp_path / "run")
    recorder.close()
    with pytest.raises(BundleError, match="no bundle"):
        verify(tmp_path)


def test_digest_again_is_what_the_recorder_got(tmp_path: Path) -> None:
    """The digests of episodes are recomputed from their rows alone."""
    evidence = played(tmp_path, episodes=3)

    found = digest_again(evidence)

    columns = [evidence.episodes[name].to_pylist() for name in ("fingerprint", "info_fingerprint")]
    assert list(zip(*columns, strict=True)) == list(found.episodes.values())
    assert (evidence.fingerprint, ()) == (found.run["fingerprint"], found.wrong)
