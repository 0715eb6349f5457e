"""Turns that were recorded and not encoded yet are read from the journal, and nothing else is."""

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pyarrow as pa
import pytest
from gymnasium import spaces

import gamekeeper as gk
from gamekeeper.episodes.buffer import Counts, added, take
from gamekeeper.episodes.encoder import LEVELS, Encoder
from gamekeeper.episodes.evidence import manifest_of
from gamekeeper.errors import RunError
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from gamekeeper.runs import recorder
from gamekeeper.runs.files import journal
from gamekeeper.runs.files.journal import HEAD
from gamekeeper.runs.files.open_streams import open_tables
from gamekeeper.runs.files.segments import JOURNAL
from gamekeeper.runs.files.store import RunStore
from gamekeeper.runs.recorder import RunRecorder
from gamekeeper.runs.run_check import recover, verify
from tests.episodes.buffers import IDENTITY, BufferSink, Given, taped
from tests.runs.plays import replayed, step_through, write_env
from tests.runs.test_recover import die
from tests.runs.walks import Turns, Walk

NOT_KEPT = ("fingerprint", "info_fingerprint")


def values(kind: str) -> Given:
    """Two agents that see values of a kind, one of them a value that isn't declared."""
    box = spaces.Box(-9, 9, (3,), np.float32)
    nested = spaces.Dict({"where": box, "says": spaces.Tuple((spaces.Text(4), spaces.Discrete(5)))})
    space, seen = {
        "box": (box, [np.float32([1, 2, 3]), np.float64([1, 2, 3]), np.float32([np.nan, 0, -0.0])]),
        "nested": (nested, [{"where": np.float32([0, 1, 2]), "says": ("ab", np.int64(3))}]),
        "several": (spaces.MultiDiscrete([3, 4]), [np.int64([1, 3]), "\ud800", np.int64([0, 0])]),
    }[kind]
    return Given(
        {"a": seen, "b": seen[::-1]},
        {"a": space, "b": box if kind == "nested" else space},
        infos={"a": [{"action_mask": np.int8([1, 0])}, {}, {"x": 1.5}]},
        rewards=[np.float32(0.1), 1.0, 2, "much"],
        states=[np.float64([1, 2]), np.float64([3, 4])],
        actions=spaces.MultiBinary(2) if kind == "nested" else None,
    )


def rows(tmp_path: Path, kind: str) -> BufferSink:
    """The buffer of two episodes, uncut."""
    if kind == "turns":
        sink = BufferSink()
        wrapped: Any = recorded_of(capture_of(Turns(), sink=sink))
        for seed in (1, 2):
            wrapped.reset(seed=seed)
            for _ in wrapped.agent_iter():
                *_, over, cut, _ = wrapped.last()
                wrapped.step(None if over or cut else 1)
        wrapped._capture.end_episode()
        return sink
    actions = [np.int8([1, 0])] if kind == "nested" else None
    return taped(values(kind), 70, episodes=2, actions=actions)


def run_of(folder: Path, sink: BufferSink, level: str, *, encoded: int, journaled: int) -> Path:
    """An open run whose first turns are in its segments, and whose first turns are in its journal.

    Args:
        encoded: turns that are in segments.
        journaled: turns after which the journal was written a second time; 0: there is none.
    """
    manifest = manifest_of(
        environment=IDENTITY, contract=None, level=level, run_seed=None, layout=sink.layout
    )
    store = RunStore.create(folder, manifest)
    if journaled:
        first, since = part(sink, journaled)
        rest, _ = added(sink.buffer, since)
        assert store.journal.write(first, sink.layout, is_timed=True)
        assert store.journal.write(rest, sink.layout, is_timed=True)
    encoder = Encoder(sink.layout, sink._encoder.open_large, level=level)
    if encoded and (turns := take(sink.buffer, most=encoded)):
        for stream, batch in encoder.encode_turns(turns).in_order():
            store.append(stream, batch)
    store.abandon()
    return folder


def part(sink: BufferSink, turns: int) -> tuple[Any, Counts]:
    """The first turns of a buffer as they are journaled, and their counts."""
    whole, buffer = list(sink.buffer.turns), sink.buffer
    rest = whole[turns * 8 :]
    del buffer.turns[turns * 8 :]
    ends, buffer.ends = buffer.ends, buffer.ends[:0]
    found = added(buffer, Counts())
    buffer.turns.extend(rest)
    buffer.ends = ends
    return found


def tables(folder: Path) -> dict[str, pa.Table]:
    """The whole turns of an open run by stream, without what only whole episodes have."""
    found, cuts = open_tables(folder, {"level": gk.load(folder).manifest["level"]}, salvage=False)
    assert cuts == ()
    return {name: table.drop_columns([n for n in NOT_KEPT if n in table.column_names])
            for name, table in found.items()}  # fmt: skip


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", ["box", "nested", "several", "turns"])
@pytest.mark.parametrize("encoded", [0, 5])
def test_journal_holds_the_rows_that_encoding_gives(
    tmp_path: Path, kind: str, level: str, encoded: int
) -> None:
    """A run of journal alone, or of segments that overlap with it, is read like one of segments."""
    wanted = run_of(tmp_path / "a", rows(tmp_path, kind), level, encoded=4096, journaled=0)
    found = run_of(tmp_path / "b", rows(tmp_path, kind), level, encoded=encoded, journaled=7)

    expected, actual = tables(wanted), tables(found)
    assert (found / JOURNAL).stat().st_size > 0
    assert expected.keys() == actual.keys()
    for name, table in expected.items():
        if name != "timings":  # the clock's
            again = actual[name].select(table.column_names)
            assert str(table.to_pylist()) == str(again.to_pylist()), name  # NaN is no NaN's equal
    assert expected["timings" if level != "actions" else "episodes"].num_rows > 0


def recorded(env: Any, run: Path, level: str = "full") -> tuple[Any, RunRecorder]:
    """A recorded environment, and its recorder, which encodes nothing that it can journal."""
    before = set(recorder._OPEN)
    wrapped = gk.record(env, run, level=level)
    (one,) = set(recorder._OPEN) - before
    one._is_due = lambda: False  # type: ignore[method-assign]  # a test decides
    return wrapped, one


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("turns", [0, 3])
def test_run_that_was_killed_before_it_encoded_is_recovered(
    tmp_path: Path, level: str, turns: int
) -> None:
    """It opens, is finalized, verifies, replays, and no journal is left."""
    write_env(tmp_path)
    wrapped, one = recorded(Walk(), tmp_path / "run", level)
    step_through(wrapped, seed=1)
    step_through(wrapped, seed=2, turns=turns)
    die(one)
    assert not list((tmp_path / "run").glob("*.arrows"))
    before = gk.load(tmp_path / "run")
    finalized = recover(tmp_path / "run")

    assert finalized.episode_table["end"].to_pylist() == ["ended", "torn"]
    assert finalized.episode_table["turns"].to_pylist() == [5, turns]
    assert before.agent_steps.num_rows == finalized.agent_steps.num_rows
    assert verify(tmp_path / "run").ok
    assert not (tmp_path / "run" / JOURNAL).exists()
    assert replayed(tmp_path / "run").verified


@pytest.mark.parametrize("at_once", [2, 4096])
def test_journal_is_empty_once_its_turns_are_encoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_once: int
) -> None:
    """Encoding empties it, what comes then is journaled anew, and closing removes it."""
    monkeypatch.setattr(recorder, "FLUSH_TURNS", at_once)
    wrapped, one = recorded(Walk(), tmp_path / "run", "actions")
    one._closing = True
    one._wake.set()
    one._thread.join()  # from now on this thread does its work
    sizes = []
    for seed in (1, 2):
        step_through(wrapped, seed=seed)
        one._journal()
        sizes.append((tmp_path / "run" / JOURNAL).stat().st_size)
        one._encode()
        sizes.append((tmp_path / "run" / JOURNAL).stat().st_size)
    wrapped.close()
    assert [size > 0 for size in sizes] == [True, False, True, False]
    assert not (tmp_path / "run" / JOURNAL).exists()
    assert gk.verify(tmp_path / "run").ok


def test_journal_leaves_large_observations_to_the_encoder(tmp_path: Path) -> None:
    """Turns with an observation that was put aside aren't written: encoding comes at once."""
    picture = spaces.Box(0, 255, (64, 64, 3), np.uint8)
    env = Given({"a": [np.zeros((64, 64, 3), np.uint8)]}, {"a": picture})
    wrapped, one = recorded(env, tmp_path / "run")
    wrapped.reset()
    wrapped.step({"a": 1})
    die(one)
    assert gk.load(tmp_path / "run").agent_steps.num_rows == 1
    assert list((tmp_path / "run").glob("*.arrows"))


def frames(data: bytes) -> Iterator[tuple[int, int]]:
    """Beginning and end of each frame."""
    at = 0
    while at < len(data):
        size, _ = HEAD.unpack_from(data, at)
        yield at, at + HEAD.size + size
        at += HEAD.size + size


def test_journal_that_was_cut_is_read_up_to_its_last_whole_frame(tmp_path: Path) -> None:
    """Wherever a kill or a power cut ends the file, the frames before it count."""
    folder = run_of(tmp_path / "run", rows(tmp_path, "box"), "full", encoded=0, journaled=7)
    data = (folder / JOURNAL).read_bytes()
    (_, first), (_, last) = frames(data)
    assert last == len(data)
    for end in (0, 3, first - 1, first, first + 5, last - 1):
        for tail in (b"", bytes(600)):
            (folder / JOURNAL).write_bytes(data[:end] + tail)
            found, _ = open_tables(folder, {"level": "full"}, salvage=False)
            steps = found.get("agent_steps")
            assert (0 if steps is None else steps.num_rows) == (14 if end >= first else 0)


def test_journal_whose_bytes_changed_is_damage(tmp_path: Path) -> None:
    """It is refused, and salvaged up to the frame that changed."""
    folder = run_of(tmp_path / "run", rows(tmp_path, "box"), "full", encoded=0, journaled=7)
    data = bytearray((folder / JOURNAL).read_bytes())
    data[-9] ^= 1
    (folder / JOURNAL).write_bytes(data)
    with pytest.raises(RunError, match="checksum"):
        gk.load(folder)
    found, cuts = open_tables(folder, {"level": "full"}, salvage=True)
    assert found["agent_steps"].num_rows == 14
    assert [cut.file for cut in cuts] == [JOURNAL]


def forged(frame: dict[str, Any], how: str) -> Any:
    """A frame of a journal, changed by somebody who computed its checksum anew."""
    given, done, turns, starts, _, usual = frame["turns"]
    columns = frame["layout"]["columns"]
    if how == "more rows than there are":
        turns[2] = 1 << 40
    elif how == "an agent that isn't there":
        given[0] = 77
    elif how == "a column of terabytes":
        columns[0][4:] = ["<f8", [1 << 30]]
    elif how == "a column of objects":
        columns[0][4:] = ["|O", [1]]
    elif how == "a text in place of bytes":
        given[1] = "text"
    elif how == "bytes of another length":
        given[1] = b"1"
    elif how == "a number in place of a list":
        frame["turns"] = 3
    elif how == "another kind of value":
        given[6] = msgpack.ExtType(9, b"x")
    elif how == "a start without an episode":
        starts[0][0] = None
    elif how == "a frame of another shape":
        return [done, usual]
    return frame


@pytest.mark.parametrize(
    "how",
    [
        "more rows than there are",
        "an agent that isn't there",
        "a column of terabytes",
        "a column of objects",
        "a text in place of bytes",
        "bytes of another length",
        "a number in place of a list",
        "another kind of value",
        "a start without an episode",
        "a frame of another shape",
    ],
)
def test_journal_that_was_forged_is_refused(tmp_path: Path, how: str) -> None:
    """Each is an error of the run that names the file, and costs no memory."""
    folder = run_of(tmp_path / "run", rows(tmp_path, "box"), "full", encoded=0, journaled=7)
    data = (folder / JOURNAL).read_bytes()
    start, end = next(frames(data))
    content = msgpack.unpackb(data[start + HEAD.size : end], unicode_errors="surrogatepass")
    changed = msgpack.packb(forged(content, how), unicode_errors="surrogatepass")
    (folder / JOURNAL).write_bytes(HEAD.pack(len(changed), zlib.crc32(changed)) + changed)
    with pytest.raises(RunError, match=f"{JOURNAL}|episodes"):
        gk.load(folder)


def test_journal_that_is_emptied_while_it_is_read_is_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bytes of two generations are no damage of a run that is being recorded."""
    folder = run_of(tmp_path / "run", rows(tmp_path, "box"), "full", encoded=0, journaled=7)
    data = (folder / JOURNAL).read_bytes()
    seen = [data[:-9] + bytes([data[-9] ^ 1]) + data[-8:]]
    monkeypatch.setattr(journal, "read_bounded", lambda *_: seen.pop() if seen else data)
    assert gk.load(folder).agent_steps.num_rows > 14
