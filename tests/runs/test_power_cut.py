"""What a power cut may do to a run: the order in which files are synced, and torn files."""

import os
import random
import shutil
import sys
from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.runs.comparison import replay
from gamekeeper.runs.files.open_streams import finalize_recovered
from gamekeeper.runs.files.segments import SEGMENT
from gamekeeper.runs.files.store import RunStore
from gamekeeper.runs.parts.part_plan import claim
from gamekeeper.runs.parts.part_tasks import merge_task, part_task
from gamekeeper.runs.run_check import recover, verify
from tests.runs import run_folders
from tests.runs.parts.here import plan
from tests.runs.run_folders import RunFiles, read

SECTOR = 512
STREAMS = ("episodes", "agent_steps", "states", "timings")
MANIFEST = "manifest.json"

Log = list[tuple[str, str]]


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> Log:
    """What the process asks of the disk from now on, in its order: `sync`, `name`, `new`, `gone`.

    A file is logged by the number that it keeps when it is renamed, and by its name.
    """
    said: Log = []
    real = {name: getattr(os, name) for name in ("fsync", "replace", "unlink", "open")}

    def fsync(descriptor: int) -> None:
        real["fsync"](descriptor)
        said.append(("sync", str(os.fstat(descriptor).st_ino)))

    def replace(source: str, target: str) -> None:
        said.append((f"name {Path(source).stat().st_ino}", Path(target).name))
        real["replace"](source, target)

    def unlink(path: str, **options: object) -> None:
        real["unlink"](path, **options)
        said.append(("gone", Path(path).name))

    def opened(path: str, flags: int, *arguments: object, **options: object) -> int:
        if flags & os.O_CREAT:
            said.append(("new", Path(os.fsdecode(path)).name))
        number: int = real["open"](path, flags, *arguments, **options)
        return number

    for name, fake in (
        ("fsync", fsync),
        ("replace", replace),
        ("unlink", unlink),
        ("open", opened),
    ):
        monkeypatch.setattr(os, name, fake)
    return said


def test_finalizing_syncs_bytes_before_names_and_names_before_the_manifest(
    tmp_path: Path, log: Log
) -> None:
    """The disk never holds a name without its bytes, or checksums without what it finalizes."""
    store = RunStore.create(tmp_path / "b", {})
    run_folders.fill(store)
    for frame in range(3):
        store.write_frame(f"{frame}.png", b"picture")
    del log[:]
    store.finalize({})

    renames = [(at, what.split()[1], name) for at, (what, name) in enumerate(log) if "name" in what]
    assert {f"{stream}.parquet" for stream in STREAMS} | {MANIFEST} == {n for _, _, n in renames}
    for at, number, _ in renames:
        assert ("sync", number) in log[:at]
    assert renames[-1][2] == MANIFEST
    last_table, manifest = renames[-2][0], renames[-1][0]
    folder = ("sync", str((tmp_path / "b").stat().st_ino))
    assert folder in log[last_table:manifest]
    frames = [*(tmp_path / "b" / "frames").iterdir(), tmp_path / "b" / "frames"]
    for path in frames:
        assert ("sync", str(path.stat().st_ino)) in log[:manifest], path
    gone = [at for at, (what, name) in enumerate(log) if what == "gone" and SEGMENT.fullmatch(name)]
    assert len(gone) == 4
    assert folder in log[manifest : min(gone)]


def test_manifest_is_on_the_disk_before_the_first_row(tmp_path: Path, log: Log) -> None:
    """The spaces that rows need are synced first, with the names of all folders that were made."""
    env = gk.record(gk.make("two_robot_line"), tmp_path / "a" / "b")
    env.reset(seed=0)
    env.close()

    first = log.index(("new", "agent_steps-0000.arrows"))
    named = [
        at for at, (what, name) in enumerate(log[:first]) if "name" in what and name == MANIFEST
    ]
    assert named
    for at in named:
        assert ("sync", log[at][0].split()[1]) in log[:at]
    assert ("sync", str((tmp_path / "a" / "b").stat().st_ino)) in log[named[-1] : first]
    for parent in (tmp_path / "a", tmp_path):
        assert ("sync", str(parent.stat().st_ino)) in log[:first]


def test_recording_syncs_no_rows(tmp_path: Path, log: Log) -> None:
    """Rows are handed to the system and not synced: the documented policy, which costs nothing."""
    store = RunStore.create(tmp_path / "b", {})
    del log[:]
    run_folders.fill(store, episodes=3, turns=20)
    store.abandon()

    assert "sync" not in {what for what, _ in log}


@pytest.mark.skipif(sys.platform == "win32", reason="workers are for POSIX systems")
def test_parts_are_not_synced_and_what_they_become_is(tmp_path: Path, log: Log) -> None:
    """A part that a power cut tears is played again: only the plan of the parts is synced."""
    wanted, storage = plan(), Storage.at(tmp_path / "parts")
    claim(storage, wanted)
    del log[:]
    given = {"storage": storage.place, "plan": wanted.to_json()}
    for number in range(wanted.episodes):
        said = part_task(lambda **fields: None, **given, first=number, stop=number + 1)
        assert said["error"] is None
    assert "sync" not in {what for what, _ in log}

    out = tmp_path / "run"
    merge_task(lambda **f: None, **given, out=str(out), parts=wanted.episodes, error=None)
    synced = {number for what, number in log if what == "sync"}
    names = (f"{MANIFEST}", *(f"{stream}.parquet" for stream in STREAMS if stream != "states"))
    assert {str((out / name).stat().st_ino) for name in names} <= synced


@pytest.mark.parametrize("stream", STREAMS)
def test_torn_segment_opens_with_what_is_whole(stream: str, tmp_path: Path) -> None:
    """Cut anywhere, or zeros from a sector on: whole turns are read, and the file is named."""
    whole = read(run_folders.open_run(tmp_path / "b", episodes=3, turns=8))
    path = tmp_path / "b" / f"{stream}-0000.arrows"
    data = path.read_bytes()
    rng = random.Random(stream)
    borders = rng.sample(range(0, len(data), SECTOR), min(12, len(data) // SECTOR))
    torn = [data[:at] + bytes(len(data) - at) for at in borders]
    torn += [data[:at] for at in rng.sample(range(len(data)), 12) if at not in _ends(data)]
    torn += [data[: at + 100] + bytes(4096) for at in rng.sample(range(len(data) - 100), 6)]

    for left in torn:
        path.write_bytes(left)
        run_files = read(tmp_path / "b")
        assert _is_prefix(run_files, whole)
        assert left == data or path.name in [cut.file for cut in run_files.cuts]


def _ends(data: bytes) -> list[int]:
    """Where a file can end with nobody being able to tell: after a message."""
    from gamekeeper.runs.untrusted.arrow_messages import PREFIX, kind_and_body, metadata_size

    at, ends = 0, [0]
    while at < len(data):
        head = PREFIX + metadata_size(data[at : at + PREFIX])
        at += head + (kind_and_body(data[at + PREFIX : at + head])[1] if head > PREFIX else 0)
        ends.append(at)
    return ends


@pytest.mark.parametrize("seed", range(6))
def test_run_torn_in_every_file_recovers_a_prefix(seed: int, tmp_path: Path) -> None:
    """With each file torn elsewhere, what is finalized is a prefix and says where it was cut."""
    whole = read(run_folders.open_run(tmp_path / "b", episodes=3, turns=8))
    rng = random.Random(seed)
    for stream in STREAMS:
        path = tmp_path / "b" / f"{stream}-0000.arrows"
        data = path.read_bytes()
        at = rng.randrange(1, len(data))
        path.write_bytes(data[:at] + bytes(rng.choice([0, len(data) - at, 4096])))
    cuts = read(tmp_path / "b", salvage=True).cuts

    finalize_recovered(tmp_path / "b", {})

    after = read(tmp_path / "b")
    assert _is_prefix(after, whole)
    assert [cut.file for cut in cuts] == [cut["file"] for cut in after.manifest.get("cuts", [])]


def _is_prefix(run_files: RunFiles, whole: RunFiles) -> bool:
    rows = run_files.agent_steps.num_rows
    part = run_files.agent_steps.to_pylist()
    is_prefix = not rows or whole.agent_steps.slice(0, rows).to_pylist() == part
    finished = 0 if run_files.timings is None else run_files.timings.num_rows
    acted = run_files.agent_steps["order"].drop_null().length() if rows else 0
    return is_prefix and (run_files.timings is None or acted == finished * len(run_folders.AGENTS))


@pytest.fixture(scope="module")
def unfinalized(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two_robot_line whose machine lost its power just before it was finalized."""
    path = tmp_path_factory.mktemp("cut") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunStore, "finalize", lambda self, manifest: self.abandon())
        env = gk.record(gk.make("two_robot_line"), path)
        for seed in range(12):
            env.reset(seed=seed)
            for turn in range(10):
                if env.agents:
                    env.step(dict.fromkeys(env.agents, (seed + turn) % 3))
        env.close()
    return path


@pytest.mark.parametrize("seed", range(4))
def test_run_torn_by_a_power_cut_recovers_and_replays(
    seed: int, unfinalized: Path, tmp_path: Path
) -> None:
    """A real run, torn in one file: it opens, recovers, verifies; its rows are the first ones."""
    shutil.copytree(unfinalized, tmp_path / "run")
    expected = gk.load(unfinalized).agent_steps.to_pylist()
    rng = random.Random(seed)
    path = rng.choice(sorted((tmp_path / "run").glob("*.arrows")))
    data = path.read_bytes()
    at = rng.randrange(0, len(data), SECTOR)
    path.write_bytes(data[:at] + bytes(rng.choice([0, len(data) - at])))

    assert gk.load(tmp_path / "run").manifest["status"] == "open"
    finalized = recover(tmp_path / "run")

    assert finalized.manifest["status"] == "recovered"
    assert verify(tmp_path / "run").ok
    rows = finalized.agent_steps.to_pylist()
    assert [row["turn"] for row in rows] == [row["turn"] for row in expected[: len(rows)]]
    if seed == 0 and rows and sys.platform == "linux":
        assert replay(tmp_path / "run").verified
