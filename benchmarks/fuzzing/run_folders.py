"""Runs in a folder, one file of each damaged or altered, their hashes made to fit again."""

import contextlib
import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import pyarrow as pa
import pyarrow.parquet as pq

import gamekeeper as gk
from benchmarks.fuzzing.damage import VALUES, altered, damaged
from gamekeeper.diagnosis.labels import label
from gamekeeper.episodes.outcome import LABELS
from gamekeeper.runs.files.folder import MANIFEST, digest_file
from gamekeeper.runs.files.manifest import manifest_digest, render
from gamekeeper.runs.files.notes import read_notes
from gamekeeper.runs.files.store import RunStore

KINDS: Final = ("line", "turns", "games", "open")


def make_runs(place: Path) -> dict[str, Path]:
    """Small runs of several kinds: both APIs, both levels, masks, infos, one still open."""
    made = {}
    for name, spec, options in (
        ("line", "two_robot_line", {}),
        ("turns", "handover", {"level": "digest"}),
        ("games", "tictactoe", {}),
    ):
        made[name] = place / f"source-{name}"
        gk.rollout(spec, episodes=2, seed=1, out=made[name], most_turns=6, **options)
        label(made[name], LABELS[0], episode=0, why="they wait for each other")
    made["open"] = place / "source-open"
    opened = gk.record(gk.make("two_robot_line"), made["open"])
    opened.reset(seed=0)
    for _ in range(3):
        opened.step(dict.fromkeys(opened.agents, 0))
    with patch.object(RunStore, "finalize", lambda self, manifest: self.abandon()):
        opened.close()  # as a kill just before finalizing leaves it
    return made


def finalize_again(folder: Path, name: str) -> None:
    """Makes a finalized manifest fit what lies there."""
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_bytes())
        files = manifest["checksums"]["files"]
        if name != MANIFEST:
            size, digest = digest_file(folder / name)
            files[name] = {"digest": digest, "size": size}
        manifest["checksums"]["manifest"] = manifest_digest(manifest)
        path.write_bytes(render(manifest))
    except Exception:  # the damage was such that nothing can be finalized: it is read as it is
        return


def read_all(folder: Path) -> None:
    """Reads a run as every command does."""
    evidence = gk.load(folder)
    evidence.summary.to_json()
    for episode in evidence.episodes:
        for turn in episode.turns:
            for name in ("rewards", "infos", "ended", "observations", "actions"):
                getattr(turn, name)
    read_notes(folder)


class Run:
    """A run in a folder of its own, one file of it damaged."""

    def __init__(self, source: Path, place: Path) -> None:
        self._folder = place / "run_files"
        self._names = sorted(path.name for path in source.iterdir() if path.is_file())
        self._bytes = {name: (source / name).read_bytes() for name in self._names}
        shutil.copytree(source, self._folder)

    def damage(self, rng: random.Random) -> tuple[str, bytes]:
        """A file and what it holds once bytes of it are damaged."""
        name = rng.choice(self._names)
        return name, damaged(self._bytes[name], list(self._bytes.values()), rng)

    def alter(self, rng: random.Random) -> tuple[str, bytes]:
        """A file and what it holds once values of it are other ones, the format still right."""
        name = rng.choice(self._names)
        if name == MANIFEST:
            return name, json.dumps(altered(json.loads(self._bytes[name]), rng)).encode()
        with contextlib.suppress(pa.ArrowException):  # what no file of its kind can hold
            if name.endswith(".parquet"):
                sink = pa.BufferOutputStream()
                table = _altered(pq.read_table(pa.BufferReader(self._bytes[name])), rng)
                pq.write_table(table, sink)
                return name, sink.getvalue().to_pybytes()
            if name.endswith(".arrows"):
                return name, _segment(_altered(_rows(self._bytes[name]), rng))
        return name, damaged(self._bytes[name], list(self._bytes.values()), rng)

    def read(
        self, name: str, data: bytes, *, with_hashes: bool, by: Callable[[Path], Any] = read_all
    ) -> None:
        """Puts the damaged file there, reads, and fixes it again."""
        path = self._folder / name
        path.write_bytes(data)
        try:
            if with_hashes:
                finalize_again(self._folder, name)
            by(self._folder)
        finally:
            path.write_bytes(self._bytes[name])
            (self._folder / MANIFEST).write_bytes(self._bytes[MANIFEST])


def _rows(segment: bytes) -> pa.Table:
    """The whole batches of a segment that may end anywhere."""
    reader = pa.ipc.open_stream(pa.BufferReader(segment))
    batches = []
    with contextlib.suppress(pa.ArrowInvalid, OSError):
        batches.extend(reader)
    return pa.Table.from_batches(batches, reader.schema)


def _segment(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_stream(sink, table.schema, options=options) as writer:
        writer.write_table(table)
    return sink.getvalue().to_pybytes()


def _altered(table: pa.Table, rng: random.Random) -> pa.Table:
    """One to three columns, or the rows, are other ones."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        table = _one_altered(table, rng)
    return table


def _one_altered(table: pa.Table, rng: random.Random) -> pa.Table:
    place = rng.randrange(table.num_columns)
    field, values = table.schema.field(place), table.column(place).to_pylist()
    kind = rng.randrange(9)
    if kind == 0:
        return table.remove_column(place)
    if kind == 1:
        rows = [rng.randrange(table.num_rows) for _ in range(table.num_rows)] or []
        return table.take(pa.array(rows, pa.int64()))
    if kind == 2:
        names = [*table.column_names]
        names[place] = rng.choice([*names, "obs.x", "@", "", "reward.x", "a\0b", "infos"])
        return table.rename_columns(names)
    if kind == 3:
        return table.set_column(place, field.with_metadata(_metadata(field, rng)), table[place])
    if kind == 4:
        return table.set_column(
            place,
            pa.field(field.name, pa.null(), metadata=field.metadata),
            pa.nulls(table.num_rows),
        )
    if kind == 5:
        return table.append_column(field, table.column(place))
    return _with_values(table, place, [_value(value, rng) for value in values])


def _with_values(table: pa.Table, place: int, values: list[Any]) -> pa.Table:
    """The column with these values: of its type where they fit it, else of theirs."""
    field = table.schema.field(place)
    for kind in (field.type, None):
        try:
            column = pa.array(values, kind)
        except (pa.ArrowException, ValueError, TypeError, OverflowError):
            continue
        new = pa.field(field.name, column.type, metadata=field.metadata)
        return table.set_column(place, new, column)
    return table


def _value(value: Any, rng: random.Random) -> Any:
    if rng.random() < 0.5:
        return value
    if isinstance(value, str) and value[:1] in ("{", "["):
        return json.dumps(altered(json.loads(value), rng))
    if isinstance(value, list) and value:
        return [rng.choice((item, float("nan"), 1e308, -1)) for item in value]
    if isinstance(value, float):
        return rng.choice((float("nan"), float("inf"), -1e308, -0.0, 5e-324))
    if isinstance(value, bytes):
        return damaged(value, [value], rng)
    near = [value, None, -1, 2**31 - 1, 0, 1, *VALUES]
    same = [each for each in near if type(each) is type(value)]
    return rng.choice(same if same and rng.random() < 0.8 else near)


def _metadata(field: pa.Field, rng: random.Random) -> dict[bytes, bytes]:
    """The column's own, altered; where it has none, words that readers look for."""
    found = dict(field.metadata or {b"leaf": b'{"dtype": "<f4", "shape": [3]}'})
    key = rng.choice(list(found))
    try:
        found[key] = json.dumps(altered(json.loads(found[key]), rng)).encode()
    except ValueError:
        found[key] = damaged(found[key], [b"x"], rng)
    return found
