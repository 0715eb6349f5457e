import json
import multiprocessing
from contextlib import suppress
from pathlib import Path

import pytest

from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.runs.files.checksums import compare_checksums, verify_notes
from gamekeeper.runs.files.manifest import render
from gamekeeper.runs.files.notes import annotate, read_notes
from gamekeeper.runs.files.store import RunStore
from tests.runs import run_folders
from tests.runs.run_folders import read


@pytest.fixture
def run_files(tmp_path: Path) -> Path:
    """A finalized run with a frame and two notes."""
    path = run_folders.finalized_run(tmp_path / "b", episodes=1, turns=2)
    annotate(path, {"label": "late"})
    annotate(path, {"label": "idle", "by": "someone"})
    return path


def test_checksums_of_an_untouched_run_holds(run_files: Path) -> None:
    """Nothing is damaged, and notes added after finalizing don't change that."""
    assert compare_checksums(run_files) == ()
    assert verify_notes(run_files) == ()


def test_checksums_finds_any_changed_byte_of_a_table(run_files: Path) -> None:
    """Whichever byte changes, its file is named."""
    for name in ("episodes", "agent_steps", "states", "timings"):
        path = run_files / f"{name}.parquet"
        whole = path.read_bytes()
        for place in range(0, len(whole), 97):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
            assert [(d.file, d.what) for d in compare_checksums(run_files)] == [
                (path.name, "changed")
            ]
        path.write_bytes(whole)
    assert compare_checksums(run_files) == ()


def test_checksums_finds_any_changed_byte_of_the_manifest(run_files: Path) -> None:
    """Also in white space, in the checksums itself, or where JSON means the same."""
    path = run_files / "manifest.json"
    whole = path.read_bytes()
    for place in range(len(whole)):
        for byte in {whole[place] ^ (1 << place % 6), ord(" ")} - {whole[place]}:
            path.write_bytes(whole[:place] + bytes([byte]) + whole[place + 1 :])
            with suppress(RunError):  # too damaged to hold checksums: said as well
                assert compare_checksums(run_files), place
    path.write_bytes(whole)
    assert compare_checksums(run_files) == ()


@pytest.mark.parametrize("spelling", [{"indent": 2}, {"sort_keys": False}, {}])
def test_checksums_finds_another_spelling(run_files: Path, spelling: dict[str, int]) -> None:
    """The same JSON spelled otherwise isn't the bytes that were finalized."""
    path = run_files / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()), **spelling))
    assert [damage.file for damage in compare_checksums(run_files)] == ["manifest.json"]
    assert read(run_files).finalized


def test_checksums_finds_missing_cut_and_extra_files(run_files: Path) -> None:
    """Each damage says what it is; what readers never look at is let be."""
    (run_files / "frames" / "0.png").unlink()
    (run_files / "frames" / "1.png").write_bytes(b"new")
    cut = (run_files / "agent_steps.parquet").read_bytes()[:-1]
    (run_files / "agent_steps.parquet").write_bytes(cut)
    (run_files / "report.html").write_text("fine")
    found = {(damage.file, damage.what) for damage in compare_checksums(run_files)}
    assert found == {
        ("frames/0.png", "missing"),
        ("frames/1.png", "extra"),
        ("agent_steps.parquet", "changed"),
    }
    assert all(damage.detail for damage in compare_checksums(run_files) if damage.what == "changed")


def test_checksums_finds_a_table_that_it_does_not_name(tmp_path: Path) -> None:
    """Timings put beside a run without timings are no evidence."""
    run_folders.finalized_run(tmp_path / "b", has_states=False)
    run_folders.finalized_run(tmp_path / "other")
    (tmp_path / "other" / "states.parquet").rename(tmp_path / "b" / "states.parquet")
    assert [(d.file, d.what) for d in compare_checksums(tmp_path / "b")] == [
        ("states.parquet", "extra")
    ]


def test_checksums_does_not_look_outside(run_files: Path, tmp_path: Path) -> None:
    """A name in the checksums that leads out of the folder, or a link there, is refused."""
    (run_files / "frames" / "0.png").unlink()
    (run_files / "frames" / "0.png").symlink_to(tmp_path)
    with pytest.raises(RunError, match="link"):
        compare_checksums(run_files)
    (run_files / "frames").rename(tmp_path / "frames")
    (run_files / "frames").symlink_to(tmp_path / "frames")
    with pytest.raises(RunError, match="link"):
        compare_checksums(run_files)


def test_checksums_of_an_open_run_does_not_exist(tmp_path: Path) -> None:
    """What was never finalized can't be damaged; the fix names who finalizes it."""
    run_folders.open_run(tmp_path / "b")
    with pytest.raises(RunError, match="never finalized") as caught:
        compare_checksums(tmp_path / "b")
    assert "gamekeeper recover" in caught.value.fix


def test_notes_come_back_in_order(run_files: Path) -> None:
    """Without the chain's own field."""
    assert read_notes(run_files) == ({"label": "late"}, {"label": "idle", "by": "someone"})


def test_notes_are_taken_while_recording(tmp_path: Path) -> None:
    """Notes that are added before and after finalizing stand in one chain."""
    store = RunStore.create(tmp_path / "b", {})
    annotate(tmp_path / "b", {"n": 1})
    annotate(tmp_path / "b", {"n": 2})
    store.finalize({})
    annotate(tmp_path / "b", {"n": 3})
    assert [note["n"] for note in read_notes(tmp_path / "b")] == [1, 2, 3]
    assert compare_checksums(tmp_path / "b") == ()


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("late", "fate", "line 1"),
        ("idle", "busy", "line 2"),
        ("someone", "another", "line 2"),
        (',"label":"late"', ', "label":"late"', "line 1"),
        (',"label":"late"', ',"x":NaN,"label":"late"', "line 1"),
        ("\n", "\n\n", "line 2"),
        ("{", "[", "line 1"),
    ],
)
def test_notes_chain_shows_changes(run_files: Path, old: str, new: str, line: str) -> None:
    """A changed line isn't what its own digest says: the last one too."""
    path = run_files / "annotations.jsonl"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    assert line in verify_notes(run_files)[0].detail
    with pytest.raises(RunError, match=line):
        read_notes(run_files)


def test_notes_chain_shows_any_changed_byte(run_files: Path) -> None:
    """Whichever byte of whichever line is another, also the end of the last line."""
    path = run_files / "annotations.jsonl"
    whole = path.read_bytes()
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert verify_notes(run_files), place
    path.write_bytes(whole[:-1])
    assert verify_notes(run_files)
    path.write_bytes(whole)
    assert verify_notes(run_files) == ()


def test_notes_chain_shows_removed_and_swapped_lines(run_files: Path) -> None:
    """The first line taken away, or both in another order."""
    path = run_files / "annotations.jsonl"
    first, second = path.read_text().splitlines(keepends=True)
    for text in (second, second + first, first + first + second):
        path.write_text(text)
        assert verify_notes(run_files)


def test_note_that_was_never_finished_was_never_said(run_files: Path) -> None:
    """A line cut by a kill is replaced by the next note; a whole one without its end is kept."""
    path = run_files / "annotations.jsonl"
    whole = path.read_text()
    path.write_text(whole[:-10])
    assert verify_notes(run_files)
    annotate(run_files, {"label": "new"})
    assert [note["label"] for note in read_notes(run_files)] == ["late", "new"]
    path.write_text(whole[:-1])
    annotate(run_files, {"label": "new"})
    assert [note["label"] for note in read_notes(run_files)] == ["late", "idle", "new"]
    assert verify_notes(run_files) == ()


def test_note_longer_than_a_block_is_found_again(run_files: Path) -> None:
    """The chain goes on from a last line of any length."""
    annotate(run_files, {"text": "x" * 300_000})
    annotate(run_files, {"text": "y"})
    assert verify_notes(run_files) == ()
    assert len(read_notes(run_files)) == 4


def test_notes_after_damage_are_refused(run_files: Path) -> None:
    """A last line that says nothing can't be followed."""
    (run_files / "annotations.jsonl").write_text("nonsense\n")
    with pytest.raises(RunError, match="damaged"):
        annotate(run_files, {"label": "new"})


@pytest.mark.parametrize("record", [{"digest": "x"}, {"x": float("nan")}, {"x": b"y"}, [1]])
def test_note_that_json_cannot_hold_is_refused(run_files: Path, record: dict[str, object]) -> None:
    """Nothing is written."""
    with pytest.raises(EvidenceError):
        annotate(run_files, record)
    assert len(read_notes(run_files)) == 2


def _annotate_ten(path: str) -> None:
    for number in range(10):
        annotate(path, {"n": number})


def test_notes_of_many_processes_stand_in_one_chain(run_files: Path) -> None:
    """Writers wait for each other."""
    spawn = multiprocessing.get_context("spawn")
    writers = [spawn.Process(target=_annotate_ten, args=(str(run_files),)) for _ in range(2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    assert verify_notes(run_files) == ()
    assert len(read_notes(run_files)) == 22


def test_manifest_has_one_spelling() -> None:
    """Equal manifests are equal bytes, whatever order they were made in."""
    assert render({"b": 1, "a": {"d": 2.5, "c": "ü"}}) == render(
        {"a": {"c": "ü", "d": 2.5}, "b": 1}
    )
