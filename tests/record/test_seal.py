import json
import multiprocessing
from contextlib import suppress
from pathlib import Path

import pytest

from gamekeeper.errors import BundleError, EvidenceError
from gamekeeper.record.files.manifest import render
from gamekeeper.record.files.seal import check_seal, verify_notes
from gamekeeper.record.files.store import Store, annotate, read, read_notes
from tests.record import bundles


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    """A sealed bundle with a frame and two notes."""
    path = bundles.sealed_bundle(tmp_path / "b", episodes=1, turns=2)
    annotate(path, {"label": "late"})
    annotate(path, {"label": "idle", "by": "someone"})
    return path


def test_seal_of_an_untouched_bundle_holds(bundle: Path) -> None:
    """Nothing is damaged, and notes added after sealing don't change that."""
    assert check_seal(bundle) == ()
    assert verify_notes(bundle) == ()


def test_seal_finds_any_changed_byte_of_a_table(bundle: Path) -> None:
    """Whichever byte changes, its file is named."""
    for name in ("episodes", "steps", "states", "timings"):
        path = bundle / f"{name}.parquet"
        whole = path.read_bytes()
        for place in range(0, len(whole), 97):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
            assert [(d.file, d.what) for d in check_seal(bundle)] == [(path.name, "changed")]
        path.write_bytes(whole)
    assert check_seal(bundle) == ()


def test_seal_finds_any_changed_byte_of_the_manifest(bundle: Path) -> None:
    """Also in white space, in the seal itself, or where JSON means the same."""
    path = bundle / "manifest.json"
    whole = path.read_bytes()
    for place in range(len(whole)):
        for byte in {whole[place] ^ (1 << place % 6), ord(" ")} - {whole[place]}:
            path.write_bytes(whole[:place] + bytes([byte]) + whole[place + 1 :])
            with suppress(BundleError):  # too damaged to hold a seal: said as well
                assert check_seal(bundle), place
    path.write_bytes(whole)
    assert check_seal(bundle) == ()


@pytest.mark.parametrize("spelling", [{"indent": 2}, {"sort_keys": False}, {}])
def test_seal_finds_another_spelling(bundle: Path, spelling: dict[str, int]) -> None:
    """The same JSON spelled otherwise isn't the bytes that were sealed."""
    path = bundle / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()), **spelling))
    assert [damage.file for damage in check_seal(bundle)] == ["manifest.json"]
    assert read(bundle).sealed


def test_seal_finds_missing_cut_and_extra_files(bundle: Path) -> None:
    """Each damage says what it is; what readers never look at is let be."""
    (bundle / "frames" / "0.png").unlink()
    (bundle / "frames" / "1.png").write_bytes(b"new")
    cut = (bundle / "steps.parquet").read_bytes()[:-1]
    (bundle / "steps.parquet").write_bytes(cut)
    (bundle / "report.html").write_text("fine")
    found = {(damage.file, damage.what) for damage in check_seal(bundle)}
    assert found == {
        ("frames/0.png", "missing"),
        ("frames/1.png", "extra"),
        ("steps.parquet", "changed"),
    }
    assert all(damage.detail for damage in check_seal(bundle) if damage.what == "changed")


def test_seal_finds_a_table_that_it_does_not_name(tmp_path: Path) -> None:
    """Timings put beside a bundle without timings are no evidence."""
    bundles.sealed_bundle(tmp_path / "b", has_states=False)
    bundles.sealed_bundle(tmp_path / "other")
    (tmp_path / "other" / "states.parquet").rename(tmp_path / "b" / "states.parquet")
    assert [(d.file, d.what) for d in check_seal(tmp_path / "b")] == [("states.parquet", "extra")]


def test_seal_does_not_look_outside(bundle: Path, tmp_path: Path) -> None:
    """A name in the seal that leads out of the folder, or a link there, is refused."""
    (bundle / "frames" / "0.png").unlink()
    (bundle / "frames" / "0.png").symlink_to(tmp_path)
    with pytest.raises(BundleError, match="link"):
        check_seal(bundle)
    (bundle / "frames").rename(tmp_path / "frames")
    (bundle / "frames").symlink_to(tmp_path / "frames")
    with pytest.raises(BundleError, match="link"):
        check_seal(bundle)


def test_seal_of_an_open_bundle_does_not_exist(tmp_path: Path) -> None:
    """What was never sealed can't be damaged; the mend names who seals it."""
    bundles.open_bundle(tmp_path / "b")
    with pytest.raises(BundleError, match="never sealed") as caught:
        check_seal(tmp_path / "b")
    assert "gamekeeper recover" in caught.value.mend


def test_notes_come_back_in_order(bundle: Path) -> None:
    """Without the chain's own field."""
    assert read_notes(bundle) == ({"label": "late"}, {"label": "idle", "by": "someone"})


def test_notes_are_taken_while_recording(tmp_path: Path) -> None:
    """A note of the recorder and one of a reader stand in one chain."""
    store = Store.create(tmp_path / "b", {})
    store.add_note({"n": 1})
    annotate(tmp_path / "b", {"n": 2})
    store.seal({})
    annotate(tmp_path / "b", {"n": 3})
    assert [note["n"] for note in read_notes(tmp_path / "b")] == [1, 2, 3]
    assert check_seal(tmp_path / "b") == ()


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("late", "fate", "line 2"),
        ("idle", "busy", None),
        ('{"label":"late"', '{ "label":"late"', "line 2"),
        ("\n", "\n\n", "line 2"),
        ("{", "[", "line 1"),
    ],
)
def test_notes_chain_shows_changes(bundle: Path, old: str, new: str, line: str | None) -> None:
    """A changed line breaks the chain at the next one (the last line has none yet to tell)."""
    path = bundle / "annotations.jsonl"
    path.write_text(path.read_text().replace(old, new, 1))
    found = verify_notes(bundle)
    assert bool(found) == (line is not None)
    if line:
        assert line in found[0].detail
        with pytest.raises(BundleError, match=line):
            read_notes(bundle)


def test_notes_chain_shows_removed_and_swapped_lines(bundle: Path) -> None:
    """The first line taken away, or both in another order."""
    path = bundle / "annotations.jsonl"
    first, second = path.read_text().splitlines(keepends=True)
    for text in (second, second + first, first + first + second):
        path.write_text(text)
        assert verify_notes(bundle)


def test_note_that_was_never_finished_was_never_said(bundle: Path) -> None:
    """A line cut by a kill is replaced by the next note; a whole one without its end is kept."""
    path = bundle / "annotations.jsonl"
    whole = path.read_text()
    path.write_text(whole[:-10])
    assert verify_notes(bundle)
    annotate(bundle, {"label": "new"})
    assert [note["label"] for note in read_notes(bundle)] == ["late", "new"]
    path.write_text(whole[:-1])
    annotate(bundle, {"label": "new"})
    assert [note["label"] for note in read_notes(bundle)] == ["late", "idle", "new"]
    assert verify_notes(bundle) == ()


def test_note_longer_than_a_block_is_found_again(bundle: Path) -> None:
    """The chain goes on from a last line of any length."""
    annotate(bundle, {"text": "x" * 300_000})
    annotate(bundle, {"text": "y"})
    assert verify_notes(bundle) == ()
    assert len(read_notes(bundle)) == 4


def test_notes_after_damage_are_refused(bundle: Path) -> None:
    """A last line that says nothing can't be followed."""
    (bundle / "annotations.jsonl").write_text("nonsense\n")
    with pytest.raises(BundleError, match="damaged"):
        annotate(bundle, {"label": "new"})


@pytest.mark.parametrize("record", [{"prev": "x"}, {"x": float("nan")}, {"x": b"y"}, [1]])
def test_note_that_json_cannot_hold_is_refused(bundle: Path, record: dict[str, object]) -> None:
    """Nothing is written."""
    with pytest.raises(EvidenceError):
        annotate(bundle, record)
    assert len(read_notes(bundle)) == 2


def _annotate_ten(path: str) -> None:
    for number in range(10):
        annotate(path, {"n": number})


def test_notes_of_many_processes_stand_in_one_chain(bundle: Path) -> None:
    """Writers wait for each other."""
    spawn = multiprocessing.get_context("spawn")
    writers = [spawn.Process(target=_annotate_ten, args=(str(bundle),)) for _ in range(2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    assert verify_notes(bundle) == ()
    assert len(read_notes(bundle)) == 22


def test_manifest_has_one_spelling() -> None:
    """Equal manifests are equal bytes, whatever order they were made in."""
    assert render({"b": 1, "a": {"d": 2.5, "c": "ü"}}) == render(
        {"a": {"c": "ü", "d": 2.5}, "b": 1}
    )
