"""Where a run can't be made or written: each refusal says why and what to do."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.runs.files import folder
from gamekeeper.runs.files.store import RunStore
from tests.runs import run_folders
from tests.runs.run_folders import read

FULL = """
import resource, sys
from gamekeeper.runs.files.store import RunStore
from tests.runs.run_folders import read
from gamekeeper.errors import RunError
from tests.runs import run_folders
store = RunStore.create(sys.argv[1], {}, segment_bytes=int(sys.argv[3]))
run_folders.fill(store, episodes=4, turns=50)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    run_folders.fill(store, episodes=4, turns=50)
    store.finalize({})
except RunError as error:
    print(error)
"""


def test_create_makes_parents_and_an_open_manifest(tmp_path: Path) -> None:
    """The folder and its parents are made; the manifest is whole from the first moment."""
    RunStore.create(tmp_path / "a" / "b", {"name": "demo"}).abandon()
    manifest = json.loads((tmp_path / "a" / "b" / "manifest.json").read_text())
    assert manifest == {"format_version": 1, "name": "demo", "status": "open"}


def test_create_takes_an_empty_folder(tmp_path: Path) -> None:
    """A folder made beforehand is fine as long as nothing is in it."""
    RunStore.create(tmp_path, {}).abandon()
    assert not read(tmp_path).finalized


@pytest.mark.parametrize(
    ("name", "message"), [("manifest.json", "a run is there"), ("notes.txt", "isn't empty")]
)
def test_create_refuses_a_folder_in_use(tmp_path: Path, name: str, message: str) -> None:
    """Nothing is overwritten, and the error names what lies there."""
    (tmp_path / name).write_text("mine")
    with pytest.raises(RunError, match=message) as caught:
        RunStore.create(tmp_path, {})
    assert name in caught.value.actual
    assert "another folder" in caught.value.fix
    assert run_folders.names(tmp_path) == {name}
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.parametrize("below", [".", "b", "b/c"])
def test_create_refuses_a_path_through_a_file(tmp_path: Path, below: str) -> None:
    """A file with the folder's name, or its parent's, is in the way."""
    (tmp_path / "file").write_text("mine")
    with pytest.raises(RunError, match=r"a file has this name|[Nn]ot a directory") as caught:
        RunStore.create(tmp_path / "file" / below, {})
    assert caught.value.fix


@pytest.mark.parametrize("name", ["a\0b", "n" * 300])
def test_create_refuses_a_name_that_no_folder_can_have(tmp_path: Path, name: str) -> None:
    """The error is ours, not the system's."""
    with pytest.raises(RunError):
        RunStore.create(tmp_path / name, {})
    assert run_folders.names(tmp_path) == set()


def test_create_refuses_a_name_that_is_no_utf8(tmp_path: Path) -> None:
    """Arrow couldn't write there: it is said before a row is played, and nothing is made."""
    with pytest.raises(RunError, match="name isn") as caught:
        RunStore.create(tmp_path / "\udcff" / "run", {})
    assert caught.value.fix
    assert run_folders.names(tmp_path) == set()


@pytest.mark.parametrize("code", [errno.EACCES, errno.EROFS, errno.ENOSPC])
def test_create_says_what_the_system_refused(
    tmp_path: Path, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No permission, a read-only disk, a full disk: reason and fix, and no folder stays behind."""

    def refuse(*_: object) -> int:
        raise OSError(code, os.strerror(code))

    # Permission bits don't bind the superuser, who often runs tests in containers.
    monkeypatch.setattr("gamekeeper.runs.files.folder.write_all", refuse)
    with pytest.raises(RunError, match=os.strerror(code)) as caught:
        RunStore.create(tmp_path / "b", {})
    assert folder.FIXES[code] == caught.value.fix
    assert run_folders.names(tmp_path) == set()


def test_create_refuses_a_manifest_that_json_cannot_hold(tmp_path: Path) -> None:
    """The error comes before anything is made."""
    with pytest.raises(EvidenceError, match="JSON"):
        RunStore.create(tmp_path / "b", {"low": float("-inf")})
    assert run_folders.names(tmp_path) == set()


def test_second_recorder_is_refused(tmp_path: Path) -> None:
    """Two recorders never write into one folder."""
    first = RunStore.create(tmp_path / "b", {"name": "first"})
    with pytest.raises(RunError, match="there already"):
        RunStore.create(tmp_path / "b", {"name": "second"})
    first.append("episodes", run_folders.begin(0))
    first.finalize({"name": "first"})
    assert read(tmp_path / "b").manifest["name"] == "first"


def test_one_of_many_recorders_gets_the_folder(tmp_path: Path) -> None:
    """Started at once on one folder, one process gets it, and the others get a RunError."""
    script = (
        "import sys\n"
        "from gamekeeper.runs.files.store import RunStore; from gamekeeper.errors import *\n"
        "sys.stdout.write('ready\\n'); sys.stdout.flush(); sys.stdin.readline()\n"
        "try: RunStore.create(sys.argv[1], {})\n"
        "except RunError: print('refused')\n"
        "else: print('made'); sys.stdout.flush(); sys.stdin.readline()\n"
    )
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", script, str(tmp_path / "b")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    answers = []
    for run in runs:
        assert run.stdout
        assert run.stdout.readline() == "ready\n"
    for run in runs:
        assert run.stdin
        run.stdin.write("go\n")
        run.stdin.flush()
    for run in runs:
        assert run.stdout
        answers.append(run.stdout.readline())
    for run in runs:
        run.communicate("end\n")
    assert sorted(answers) == ["made\n", "refused\n", "refused\n"]
    assert run_folders.names(tmp_path / "b") == {"manifest.json"}


def test_append_on_a_full_disk_keeps_whole_batches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A write that stops half-way is taken back: whole batches stand, and more may come."""
    made = RunStore.create(tmp_path / "b", {})
    run_folders.fill(made, episodes=1)
    made.append("episodes", run_folders.begin(1))
    before = read(tmp_path / "b")

    def half(descriptor: int, data: bytes) -> None:
        os.write(descriptor, bytes(data)[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("gamekeeper.runs.files.segments.write_all", half)
        with pytest.raises(RunError, match="No space left") as caught:
            made.append("agent_steps", run_folders.steps(1, 0, 2))
    assert "free some space" in caught.value.fix
    after = read(tmp_path / "b")
    assert before.agent_steps.equals(after.agent_steps)
    assert after.cuts == ()
    made.append("agent_steps", run_folders.steps(1, 0, 2))
    made.append("timings", run_folders.timings(1, 0, 2))
    made.finalize({})
    assert before.agent_steps.num_rows + 4 == read(tmp_path / "b").agent_steps.num_rows


@pytest.mark.skipif(sys.platform == "win32", reason="no limits on file sizes")
@pytest.mark.parametrize(("segment_bytes", "limit_bytes"), [(1 << 20, 9_000), (2_000, 5_000)])
def test_checksums_on_a_full_disk_leaves_a_readable_run(
    tmp_path: Path, segment_bytes: int, limit_bytes: int
) -> None:
    """Where the Parquet files find no room, the segments stay and are read."""
    command = [sys.executable, "-c", FULL, str(tmp_path / "b"), str(limit_bytes)]
    said = subprocess.run(
        [*command, str(segment_bytes)], capture_output=True, text=True, check=True
    ).stdout
    assert "File too large" in said
    assert "ulimit -f" in said
    run_files = read(tmp_path / "b")
    assert not run_files.finalized
    assert run_files.agent_steps.num_rows >= 4 * 51 * 2
    assert not list((tmp_path / "b").glob("*.tmp"))


@pytest.mark.parametrize(
    "name", ["../x", "/etc/x", "a/../../x", "", ".", "a//b", "C:x", "a\\b", "nul.png", "a\nb"]
)
def test_frame_names_stay_in_the_folder(tmp_path: Path, name: str) -> None:
    """No name leads out of `frames/`, on any system."""
    made = RunStore.create(tmp_path / "b", {})
    with pytest.raises(RunError, match="leave the run"):
        made.write_frame(name, b"x")
    assert run_folders.names(tmp_path) == {"b"}


def test_frames_are_written_once(tmp_path: Path) -> None:
    """A frame may lie in a folder of its own; a name that is taken is refused."""
    made = RunStore.create(tmp_path / "b", {})
    made.write_frame("0/1.png", b"first")
    with pytest.raises(RunError, match="exists already"):
        made.write_frame("0/1.png", b"second")
    assert (tmp_path / "b" / "frames" / "0" / "1.png").read_bytes() == b"first"
