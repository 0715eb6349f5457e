"""The root digest covers every byte of a run as it was finalized."""

import shutil
import subprocess
from pathlib import Path

import pytest

from gamekeeper.runs.files.checksums import root_digest
from gamekeeper.runs.files.notes import annotate
from gamekeeper.runs.run_check import verify
from tests.runs import run_folders


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A finalized run with a frame and an annotation."""
    path = run_folders.finalized_run(tmp_path / "b", episodes=1, turns=2)
    annotate(path, {"label": "late"})
    return path


def test_root_digest_changes_with_any_byte(run: Path) -> None:
    """Whichever file of the run has another byte, one more or one less."""
    roots, files = {root_digest(run)}, [path for path in run.rglob("*") if path.is_file()]
    for path in files:
        if path.name in ("manifest.json", "annotations.jsonl"):
            continue
        whole = path.read_bytes()
        others = [whole + b"\n", whole[:-1]]
        others += [
            whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :]
            for place in range(0, len(whole), 97)
        ]
        for other in others:
            path.write_bytes(other)
            found = root_digest(run)
            assert found not in roots
            roots.add(found)
        path.write_bytes(whole)
    manifest = run / "manifest.json"
    whole = manifest.read_bytes()
    manifest.write_bytes(whole + b" ")
    assert root_digest(run) not in roots
    manifest.write_bytes(whole)
    assert root_digest(run) in roots


def test_root_digest_without_reading_the_files_is_the_same(run: Path) -> None:
    """The digests that the manifest names are those of the files, while nothing is damaged."""
    assert root_digest(run) == root_digest(run, check=False)


def test_annotations_leave_the_root_digest_as_it_was(run: Path) -> None:
    """A label that is added makes no other run of it; verifying counts the annotations."""
    before = root_digest(run)
    annotate(run, {"label": "idle"})
    found = verify(run, root=before)
    assert found.matches
    assert found.annotations == 2
    assert "2 annotations, added later by label, diagnose or attribute: not in the root" in str(
        found
    )


def test_root_digest_is_the_same_wherever_the_run_lies(run: Path, tmp_path: Path) -> None:
    """A copy has it too, also with strays beside its files."""
    shutil.copytree(run, tmp_path / "copy")
    (tmp_path / "copy" / "report.html").write_text("a stray")
    assert root_digest(tmp_path / "copy") == root_digest(run)


def test_root_digest_is_what_b2sum_prints(run: Path) -> None:
    """A reader needs nothing of ours to compute it."""
    b2sum = shutil.which("b2sum")
    if b2sum is None:
        pytest.skip("needs b2sum of GNU coreutils")
    files = (path.relative_to(run).as_posix() for path in run.rglob("*") if path.is_file())
    names = sorted(name for name in files if name != "annotations.jsonl")
    listed = subprocess.run([b2sum, "-l", "256", *names], cwd=run, capture_output=True, check=True)
    whole = subprocess.run(
        [b2sum, "-l", "256"], input=listed.stdout, capture_output=True, check=True
    )
    assert whole.stdout.split()[0].decode() == root_digest(run)


def test_root_digest_of_an_open_run_does_not_exist(tmp_path: Path) -> None:
    """Its files still grow."""
    run_folders.open_run(tmp_path / "b")
    assert root_digest(tmp_path / "b") is None
