"""Small batches of every stream, and runs made of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.evidence import NO_STEPS
from gamekeeper.runs.files.folder import MANIFEST
from gamekeeper.runs.files.manifest import checksums_of, load_manifest
from gamekeeper.runs.files.open_streams import open_tables
from gamekeeper.runs.files.parquet_tables import TableReader
from gamekeeper.runs.files.run_files import check_finalized
from gamekeeper.runs.files.schema import STREAMS
from gamekeeper.runs.files.segments import Cut
from gamekeeper.runs.files.store import RunStore

AGENTS = ("carrier_0", "picker_0")
EMPTY = {"episodes": EPISODES.empty_table(), "agent_steps": NO_STEPS.empty_table()}


@dataclass(frozen=True)
class RunFiles:
    """The streams of a run, with whatever columns they have; None where one wasn't recorded."""

    manifest: dict[str, Any]
    finalized: bool
    cuts: tuple[Cut, ...] = ()
    episodes: Any = None
    agent_steps: Any = None
    states: Any = None
    timings: Any = None


def read(folder: Path, *, check: bool = True, salvage: bool = False) -> RunFiles:
    """The streams of a run in whole tables, compared with their checksums where it has them."""
    manifest = load_manifest(folder)
    checksums = checksums_of(manifest, folder / MANIFEST)
    if checksums is None:
        tables, cuts = open_tables(folder, manifest, salvage=salvage)
        return RunFiles(manifest, False, cuts, **(EMPTY | tables))
    if check:
        check_finalized(folder, manifest, checksums)
    names = [name for name in STREAMS if f"{name}.parquet" in checksums.files]
    tables = {name: TableReader(folder / f"{name}.parquet", name).read() for name in names}
    return RunFiles(manifest, True, **(EMPTY | tables))


def begin(episode: int) -> pa.RecordBatch:
    """The row of an episode that begins."""
    return _episode(episode, seed=episode * 7)


def end(episode: int, turns: int) -> pa.RecordBatch:
    """The row of an episode that has ended."""
    return _episode(episode, turns=turns, ended="ended")


def steps(episode: int, first: int, stop: int, *, acted: bool = True) -> pa.RecordBatch:
    """[turns x agents] rows of turns `first` to `stop`, with observations that no two share."""
    turns = np.repeat(np.arange(first, stop, dtype=np.int32), len(AGENTS))
    rows = len(turns)
    obs = np.random.default_rng([episode, first]).normal(size=rows * 3).astype(np.float32)
    order = pa.array(np.arange(rows) % len(AGENTS), pa.int16(), mask=np.full(rows, not acted))
    shape = {"shape": "[3]"}
    return pa.record_batch(
        [
            pa.array(np.full(rows, episode, np.int32)),
            pa.array(turns),
            pa.array(np.array(AGENTS)[np.arange(rows) % len(AGENTS)]),
            order,
            pa.FixedSizeListArray.from_arrays(pa.array(obs), 3),
            pa.array(np.full(rows, 0.5), mask=np.full(rows, not acted)),
        ],
        schema=pa.schema(
            [
                ("episode", pa.int32()),
                ("turn", pa.int32()),
                ("agent", pa.string()),
                ("order", pa.int16()),
                pa.field("obs", pa.list_(pa.float32(), 3), metadata=shape),
                ("reward", pa.float64()),
            ]
        ),
    )


def states(episode: int, first: int, stop: int) -> pa.RecordBatch:
    """A row a turn."""
    return _by_turn(episode, first, stop, "state", pa.float32())


def timings(episode: int, first: int, stop: int) -> pa.RecordBatch:
    """A row a finished turn."""
    return _by_turn(episode, first, stop, "wall_ns", pa.int64())


def fill(
    store: RunStore, *, episodes: int = 2, turns: int = 6, flush: int = 2, has_states: bool = True
) -> None:
    """Whole episodes, flushed every few turns in the recorder's order, each with closing rows."""
    for episode in range(episodes):
        store.append("episodes", begin(episode))
        for first in range(0, turns, flush):
            store.append("agent_steps", steps(episode, first, first + flush))
            if has_states:
                store.append("states", states(episode, first, first + flush))
            store.append("timings", timings(episode, first, first + flush))
        store.append("agent_steps", steps(episode, turns, turns + 1, acted=False))
        if has_states:
            store.append("states", states(episode, turns, turns + 1))
        store.append("episodes", end(episode, turns))


def open_run(path: Path, **options: int) -> Path:
    """A run whose recorder ended without finalizing it."""
    store = RunStore.create(path, {"name": "demo"})
    fill(store, **options)
    store.abandon()
    return path


def finalized_run(path: Path, **options: int) -> Path:
    """A finalized run with a frame."""
    store = RunStore.create(path, {"name": "demo"})
    fill(store, **options)
    store.write_frame("0.png", b"picture")
    store.finalize({"name": "demo", "status": "finalized"})
    return path


def names(folder: Path) -> set[str]:
    """What lies in a folder."""
    return {path.name for path in folder.iterdir()}


def _episode(
    episode: int, *, seed: int | None = None, turns: int | None = None, ended: str | None = None
) -> pa.RecordBatch:
    return pa.record_batch(
        {
            "episode": pa.array([episode], pa.int32()),
            "seed": pa.array([seed], pa.int64()),
            "turns": pa.array([turns], pa.int32()),
            "end": pa.array([ended], pa.string()),
        }
    )


def _by_turn(episode: int, first: int, stop: int, name: str, kind: pa.DataType) -> pa.RecordBatch:
    turns = np.arange(first, stop, dtype=np.int32)
    return pa.record_batch(
        {
            "episode": pa.array(np.full(len(turns), episode, np.int32)),
            "turn": pa.array(turns),
            name: pa.array(turns * 10).cast(kind),
        }
    )
