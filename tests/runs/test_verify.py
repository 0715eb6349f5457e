from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.runs.files.checksums import root_digest
from gamekeeper.runs.files.folder import digest_file
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recorder import RunRecorder
from gamekeeper.runs.run_check import digest_again, verify
from tests.runs.finalize_again import finalize_again, finalize_again_table
from tests.runs.plays import played

FILES = (
    "episodes.parquet",
    "manifest.json",
    "states.parquet",
    "agent_steps.parquet",
    "timings.parquet",
)


@pytest.fixture(scope="module")
def finalized(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small finalized run, for tests that leave it as it was."""
    folder = tmp_path_factory.mktemp("verify")
    played(folder, episodes=1, env_kwargs={"turns": 1})
    return folder / "run"


@pytest.mark.parametrize("env", ["Walk", "Turns"])
@pytest.mark.parametrize("level", ["full", "digest"])
def test_verify_finds_a_run_self_consistent(tmp_path: Path, env: str, level: str) -> None:
    """A run that nobody touched digests to its fingerprint."""
    evidence = played(tmp_path, env=env, level=level)

    found = verify(tmp_path / "run")

    assert found.ok, str(found)
    assert (found.self_consistent, found.matches, found.damage) == (True, None, ())
    assert evidence.fingerprint == found.fingerprint
    assert evidence.root == found.root == root_digest(tmp_path / "run")
    digests = f"fingerprint {evidence.fingerprint}\nroot digest {found.root}\n"
    assert f"whole: every file matches its checksum\n{digests}" in str(found)
    assert str(found).splitlines()[-1] == found.not_checked


@pytest.mark.parametrize("digits", [32, 40, 64])
@pytest.mark.parametrize("name", ["root", "fingerprint"])
def test_verify_compares_with_a_digest_from_elsewhere(
    finalized: Path, name: str, digits: int
) -> None:
    """The first digits of the right one match, in capitals too; another doesn't, nor do too few."""
    right = getattr(load(finalized), name).removeprefix("full:")[:digits]
    wrong = right[:-1] + ("0" if right[-1] != "0" else "1")

    assert verify(finalized, **{name: f" {right.upper()}...\n"}).ok
    found = verify(finalized, **{name: wrong})
    assert (found.self_consistent, found.matches, found.ok) == (True, False, False)
    assert found.to_json()["matches"] is False
    for nonsense in (right[:31], "", "x" * 64, "0" * 65):
        with pytest.raises(EvidenceError, match="this is no"):
            verify(finalized, **{name: nonsense})


@pytest.mark.parametrize("has_level", [True, False])
def test_verify_names_the_option_of_a_digest_that_was_given_to_the_other(
    finalized: Path, has_level: bool
) -> None:
    """A run's fingerprint as its root digest, and the other way round, is a mistake, no verdict."""
    evidence = load(finalized)
    assert evidence.root is not None
    digits = evidence.fingerprint if has_level else evidence.fingerprint.partition(":")[2]
    with pytest.raises(EvidenceError, match="this is a fingerprint") as error:
        verify(finalized, root=digits)
    assert "--fingerprint (in Python, fingerprint=)" in str(error.value.fix)
    with pytest.raises(EvidenceError, match="this is a root digest") as error:
        verify(finalized, fingerprint=evidence.root)
    assert "--root (in Python, root=)" in str(error.value.fix)


def test_verify_refuses_a_fingerprint_of_another_level(finalized: Path) -> None:
    """A level in front of the digits is that of the run, or nothing is compared."""
    right = load(finalized).fingerprint
    assert verify(finalized, fingerprint=right).ok
    with pytest.raises(EvidenceError, match="different levels"):
        verify(finalized, fingerprint=right.replace("full", "actions"))


def test_verify_wants_both_digests_to_match(finalized: Path) -> None:
    """Where both are given, one that is another is enough to fail."""
    evidence = load(finalized)
    assert evidence.root
    assert verify(finalized, root=evidence.root, fingerprint=evidence.fingerprint).ok
    assert not verify(finalized, root="0" * 32, fingerprint=evidence.fingerprint).ok
    assert not verify(finalized, root=evidence.root, fingerprint="0" * 32).ok


def test_verify_says_in_a_line_what_was_not_checked(finalized: Path) -> None:
    """Nothing is left open with a root digest; less with a fingerprint than without."""
    evidence = load(finalized)
    assert verify(finalized, root=evidence.root).not_checked is None
    for found, told in (
        (verify(finalized), "make all its digests fit"),
        (verify(finalized, fingerprint=evidence.fingerprint), "which no fingerprint covers"),
    ):
        assert told in str(found.to_json()["not_checked"])
        assert "\n" not in str(found.not_checked)
        assert "in Python, root=X" in str(found)


FORGED = {
    "contract": {"name": "another"},
    "status": "recovered",
    "level": "digest",
    "versions": {"numpy": "0.1"},
    "agents": ["nobody"],
    "info_fingerprint": "0" * 64,
}


@pytest.mark.parametrize("name", FORGED)
def test_root_digest_covers_what_the_manifest_says(tmp_path: Path, name: str) -> None:
    """Forged with checksums that fits, it is another run."""
    root = played(tmp_path, episodes=1).root
    finalize_again(tmp_path / "run", **{name: FORGED[name]})
    assert verify(tmp_path / "run", root=root).matches is False


@pytest.mark.parametrize(
    ("stream", "column"),
    [
        ("agent_steps", "info"),
        ("agent_steps", "extra"),
        ("episodes", "policies"),
        ("episodes", "turns"),
        ("episodes", "end"),
        ("timings", "wall_ns"),
    ],
)
def test_root_digest_covers_every_column(tmp_path: Path, stream: str, column: str) -> None:
    """Also those that no fingerprint covers, and one that a forger adds."""
    root = played(tmp_path, episodes=1).root
    table = pq.read_table(tmp_path / "run" / f"{stream}.parquet")
    empty = pa.nulls(table.num_rows, pa.string() if column == "extra" else table[column].type)
    if column == "extra":
        table = table.append_column(column, empty)
    else:
        table = table.set_column(table.column_names.index(column), column, empty)
    finalize_again_table(tmp_path / "run", stream, table)
    found = verify(tmp_path / "run", root=root)
    assert (found.matches, found.ok) == (False, False)


def test_verify_lists_strays(tmp_path: Path) -> None:
    """What is no part of the run is named: files, folders, links; it is no damage."""
    root = played(tmp_path, episodes=1).root
    run = tmp_path / "run"
    (run / "scipy.py").write_text("")
    (run / "package").mkdir()
    (run / "package" / "__init__.py").write_text("")
    (run / "link").symlink_to(tmp_path)
    (run / "annotations.jsonl").write_text("")
    found = verify(run, root=root)
    assert found.ok
    assert found.to_json()["strays"] == ["link", "package/", "scipy.py"]
    assert "stray (no part of the run): scipy.py" in str(found)


def test_verify_finds_changed_bytes_of_the_manifest(finalized: Path) -> None:
    """Whatever byte of the manifest is flipped, verify says damage, and raises nothing."""
    path = finalized / "manifest.json"
    data = path.read_bytes()
    try:
        for place in range(0, len(data), 4):
            path.write_bytes(flipped(data, place, 1 if place % 8 else 0x80))
            assert was_damaged(finalized), (place, data[place - 20 : place + 20])
    finally:
        path.write_bytes(data)


def flipped(data: bytes, place: int, bits: int) -> bytes:
    """The bytes with one of them changed."""
    return data[:place] + bytes([data[place] ^ bits]) + data[place + 1 :]


def was_damaged(run: Path) -> set[str]:
    """The files that verify finds damaged; a version that nobody wrote yet is refused instead."""
    try:
        found = verify(run)
    except RunError as error:
        return {"manifest.json"} if "newer format" in str(error) else set()
    return set() if found.ok else {each.file for each in found.damage}


@settings(
    max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(data=st.data())
def test_verify_finds_changed_bytes_of_every_file(finalized: Path, data: st.DataObject) -> None:
    """A flipped byte, a cut and an appended byte are found in any file, and the file is named.

    A checksum that was changed in the manifest names the file that it is of: which of the two was
    changed can't be told.
    """
    name = data.draw(st.sampled_from(FILES))
    whole = (finalized / name).read_bytes()
    place = data.draw(st.integers(0, len(whole) - 1))
    other = flipped(whole, place, data.draw(st.integers(1, 255)))
    changed = data.draw(st.sampled_from([other, whole[:place], whole + b"\n"]))
    try:
        (finalized / name).write_bytes(changed)
        damaged = was_damaged(finalized)
        assert damaged if name == "manifest.json" else name in damaged
    finally:
        (finalized / name).write_bytes(whole)


def test_verify_finds_a_column_that_a_changed_byte_named_otherwise(finalized: Path) -> None:
    """The table is named as changed; that it can't be read then raises nothing."""
    path = finalized / "states.parquet"
    whole = path.read_bytes()
    try:
        path.write_bytes(whole.replace(b"nonconforming", b"nonconformind"))
        assert was_damaged(finalized) == {"states.parquet"}
    finally:
        path.write_bytes(whole)


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
def test_verify_finds_rows_that_were_finalized_again(tmp_path: Path, column: str) -> None:
    """Who changes a row and finalizes it again is found by the fingerprint of its episode."""
    played(tmp_path)
    path = tmp_path / "run" / "agent_steps.parquet"
    table = pq.read_table(path)
    place = table.schema.get_field_index(column)
    values = table[column].to_pylist()
    row = next(row for row, value in enumerate(values) if value and value != values[0])
    values[0] = values[row]
    field = table.schema.field(place)
    changed = table.set_column(place, field, pa.array(values, field.type))
    pq.write_table(changed, path)
    size, digest = digest_file(path)
    checksums = dict(load(tmp_path / "run", check=False).manifest["checksums"])
    checksums["files"]["agent_steps.parquet"] = {"size": size, "digest": digest}
    finalize_again(tmp_path / "run", checksums=checksums)

    found = verify(tmp_path / "run")

    assert not found.ok
    assert not found.self_consistent
    assert "episode 0 doesn't digest to its fingerprint" in str(found)


def test_verify_finds_a_fingerprint_that_was_finalized_again(tmp_path: Path) -> None:
    """A manifest that names another fingerprint contradicts its rows."""
    played(tmp_path, episodes=1)
    finalize_again(tmp_path / "run", fingerprint="f" * 64)

    found = verify(tmp_path / "run", fingerprint="f" * 64)

    assert (found.self_consistent, found.matches) == (False, False)
    assert [each.file for each in found.damage] == ["manifest.json"]


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
    finalize_again(tmp_path / "run", **{key: value})

    found = verify(tmp_path / "run")

    assert not found.ok or key in ("terms", "agents")


@pytest.mark.parametrize("fault", [AttributeError, NameError, TypeError, KeyError, AssertionError])
def test_verify_does_not_call_a_fault_of_ours_damage(
    finalized: Path, monkeypatch: pytest.MonkeyPatch, fault: type[Exception]
) -> None:
    """An exception that broken bytes can't cause leaves as it is: the run is whole."""

    def broken(**_: object) -> None:
        raise fault("a fault of ours")

    monkeypatch.setattr("gamekeeper.runs.run_check.episode_header", broken)
    with pytest.raises(fault, match="a fault of ours"):
        verify(finalized)


def test_verify_refuses_what_was_never_finalized(tmp_path: Path) -> None:
    """A run that is still recorded has no checksums to compare with; no run has none at all."""
    recorder = RunRecorder(tmp_path / "run", environment={})

    with pytest.raises(RunError, match="never finalized"):
        verify(tmp_path / "run")
    recorder.close()
    with pytest.raises(RunError, match="no run"):
        verify(tmp_path)


def test_digest_again_is_what_the_recorder_got(tmp_path: Path) -> None:
    """The digests of episodes are recomputed from their rows alone."""
    evidence = played(tmp_path, episodes=3)

    found = digest_again(evidence)

    columns = [
        evidence.episode_table[name].to_pylist() for name in ("fingerprint", "info_fingerprint")
    ]
    assert list(zip(*columns, strict=True)) == list(found.episodes.values())
    assert (evidence.fingerprint, ()) == (found.run["fingerprint"], found.wrong)
