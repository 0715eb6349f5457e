"""What an agent-step, an episode, a part and a task cost, and what that comes to far from here.

All times are of the processor, of this process and its threads, so that a busy machine disturbs
them little; bytes are of files. The last lines carry the figures to 10^10 agent-steps on paper.

JSON lines: {"figure": "level", "task", "level", "cpu_us", "bytes"} an agent-step: `tally` counts
and keeps nothing, `digest` and `full` are finalized runs; {"figure": "kernel", ...} the same of a
batch of 1,024 copies; {"figure": "store", "segments_bytes", "finalized_bytes"} an agent-step, while
recording and after; {"figure": "part"}: what a part costs beyond its steps; {"figure": "merge",
"mb_per_s", "rows_per_s"}; {"figure": "receipts", "bytes", "put_us", "get_us", "list_us"} each;
{"figure": "episodes", "merge_us", "fingerprint_us", "bytes", "memory_bytes"} an episode;
{"figure": "executor", "tasks_per_s", "driver_cpu_us"} by the wall clock; {"figure": "query",
"rows_per_s"}; {"figure": "paper", ...}.

    python benchmarks/scale.py [--agent-steps 24000] [--only level,merge]
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
from kernel_recording import once

import gamekeeper as gk
from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.evidence import fingerprints
from gamekeeper.episodes.tables import merged_episodes
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import WorkTask
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.rollouts.tally import tally
from gamekeeper.runs.parts.part_plan import FOLDER, key_of
from gamekeeper.runs.parts.part_tasks import merge, part_task
from gamekeeper.runs.parts.receipts import Receipt, receipt_of
from gamekeeper.runs.recording import joint_policy_of

SPREAD: Final = "mpe2.simple_spread_v3:parallel_env"
TASKS: Final = {"two_robot_line": "two_robot_line", "spread": SPREAD, "warehouse": "warehouse"}
KERNELS: Final = ("two_robot_line", "warehouse")
COPIES: Final = 1_024
SMALL: Final = 12
"""Parts of one episode each, beside two large ones."""
RECEIPTS: Final = 200
NULLS: Final = 2_000
EPISODES_MADE: Final = 50_000
GIB: Final = 2**30
NODES: Final = 100
CORES: Final = 32
LINK_BYTES_PER_S: Final = 10e9 / 8
STORE_ROUND_TRIP_S: Final = 0.02
"""Of a request to an object store; an assumption."""
WANTED: Final = 1e10


def cpu_s() -> float:
    """Seconds of the processor that this process has taken, its threads too."""
    return time.process_time()


def spent_s(run: Callable[[], Any]) -> float:
    """What of the processor a call takes."""
    begun_s = cpu_s()
    run()
    return cpu_s() - begun_s


def size_of(folder: Path) -> int:
    """Bytes of all files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def tallied(spec: str, agent_steps: int) -> tuple[float, int]:
    """Seconds of play that is counted and not kept, and how many episodes that were.

    They are the first of run 0: what a recording of as many holds too.
    """
    env = open_env(spec).env
    capture_of(env)
    joint_policy = joint_policy_of("random", env, None)
    about = episodes = 0
    begun_s = cpu_s()
    while about < agent_steps:
        play = EpisodePlan(seed=episode_seed(0, episodes), stream=episodes)
        outcome = tally(play, env, joint_policy=joint_policy)
        about += max(outcome.turns, 1) * len(outcome.returns)
        episodes += 1
    seconds = cpu_s() - begun_s
    env.close()
    return seconds, episodes


def levels(agent_steps: int) -> Iterator[dict[str, Any]]:
    """What is kept of a step, and what that costs; a first run warms up and isn't counted."""
    for name, spec in TASKS.items():
        tallied(spec, 500)
        seconds, episodes = tallied(spec, agent_steps)
        lines = [recorded(name, spec, level, episodes) for level in ("digest", "full")]
        done = lines[0].pop("agent_steps")
        assert done == lines[1].pop("agent_steps")
        yield {
            "figure": "level",
            "task": name,
            "level": "tally",
            "cpu_us": 1e6 * seconds / done,
            "bytes": 0.0,
            "steps_an_episode": done / episodes,
        }
        yield from lines


def recorded(name: str, spec: str, level: str, episodes: int) -> dict[str, Any]:
    """A recording in this process, finalized."""
    with tempfile.TemporaryDirectory(prefix="scale-") as folder:
        gk.rollout(spec, episodes=2, out=Path(folder, "warm"), level=level)
        out = Path(folder, "run")
        begun_s = cpu_s()
        evidence = gk.rollout(spec, episodes=episodes, out=out, level=level)
        seconds = cpu_s() - begun_s
        done = acted(evidence)
        return {
            "figure": "level",
            "task": name,
            "level": level,
            "cpu_us": 1e6 * seconds / done,
            "bytes": size_of(out) / done,
            "agent_steps": done,
        }


def acted(evidence: Any) -> int:
    """Agent-steps of a run: rows in which somebody acted."""
    order = evidence.agent_steps.column("order")
    return len(order) - int(order.null_count)


def kernels(agent_steps: int) -> Iterator[dict[str, Any]]:
    """A batch of copies, bare and recorded."""
    for task in KERNELS:
        once(task, "kernel", COPIES, "digest", COPIES * 8)  # compiles
        for level in ("digest", "full"):
            found = once(task, "kernel", COPIES, level, 4 * agent_steps)
            yield {
                "figure": "kernel",
                "task": task,
                "level": level,
                "bare_us": found["bare_us"],
                "cpu_us": found["bare_us"] + found["overhead_cpu_us"] + found["close_us"],
                "bytes": found["bytes"],
            }


def stores(agent_steps: int) -> Iterator[dict[str, Any]]:
    """A run's files just before it is finalized, and after."""
    with tempfile.TemporaryDirectory(prefix="scale-") as folder:
        out, seen = Path(folder, "run"), [0]
        episodes = agent_steps // 75

        def look(done: int) -> None:
            if done == episodes:
                time.sleep(0.2)  # the writer flushes every 40 ms
                seen[0] = size_of(out)

        evidence = gk.rollout(SPREAD, episodes=episodes, out=out, after_episode=look)
        done = acted(evidence)
        yield {
            "figure": "store",
            "task": "spread",
            "segments_bytes": seen[0] / done,
            "finalized_bytes": size_of(out) / done,
        }


def merges(agent_steps: int) -> Iterator[dict[str, Any]]:
    """Runs of many small parts and of two large ones: what a part costs, and what a step."""
    with tempfile.TemporaryDirectory(prefix="scale-") as folder:
        large = max(agent_steps // 75 // 2, 16)
        played(Path(folder, "warm"), [1])
        small = Merged.of(Path(folder, "small"), [1] * SMALL)
        big = Merged.of(Path(folder, "large"), [large] * 2)
        of_each, of_step = fitted(small, big, "merge_s")
        yield {
            "figure": "part",
            "play_ms": 1e3 * fitted(small, big, "play_s")[0],
            "merge_ms": 1e3 * of_each,
            "bytes": fitted(small, big, "bytes")[0],
        }
        yield {
            "figure": "merge",
            "cpu_us": 1e6 * of_step,
            "rows_per_s": 1 / of_step,
            "mb_per_s": fitted(small, big, "bytes")[1] / of_step / 1e6,
        }
        yield from listed(Storage.at(Path(folder, "many")), small.receipt_bytes)
        yield from queried(Path(folder, "large", "run"))


@dataclass(frozen=True)
class Merged:
    """Parts and the run of them."""

    parts: int
    steps: int
    play_s: float
    merge_s: float
    bytes: int
    receipt_bytes: int

    @classmethod
    def of(cls, folder: Path, sizes: list[int]) -> Merged:
        """Plays parts of so many episodes, one after the other in this process."""
        begun_s = cpu_s()
        parts = played(folder, sizes)
        play_s, storage = cpu_s() - begun_s, Storage.at(folder / "parts")
        merge_s = spent_s(lambda: merge(storage, parts, folder / "run"))
        notes = sum(path.stat().st_size for path in (folder / "parts" / FOLDER).glob("*.json"))
        return cls(
            len(sizes),
            acted(gk.load(folder / "run")),
            play_s,
            merge_s,
            size_of(folder / "parts") - notes,
            notes // len(sizes),
        )


def fitted(small: Merged, large: Merged, field: str) -> tuple[float, float]:
    """Of a line through both: what each part adds, and what each step."""
    a, b = getattr(small, field), getattr(large, field)
    step = (b / large.parts - a / small.parts) / (
        large.steps / large.parts - small.steps / small.parts
    )
    return a / small.parts - step * small.steps / small.parts, step


def played(folder: Path, sizes: list[int]) -> list[Receipt]:
    """Parts of so many episodes each, and their receipts."""
    storage, first, found = Storage.at(folder / "parts"), 0, []
    plan = RolloutPlan(spec=SPREAD, episodes=sum(sizes))
    for size in sizes:
        part_task(
            lambda **fields: None,
            storage=storage.place,
            plan=plan.to_json(),
            first=first,
            stop=first + size,
        )
        receipt = receipt_of(storage, key_of(range(first, first + size)))
        assert receipt is not None
        found.append(receipt)
        first += size
    return found


def listed(storage: Storage, size: int) -> Iterator[dict[str, Any]]:
    """Receipts put, listed and read, one by one, in a folder of this machine's disk."""
    text = b"x" * size
    names = [f"many/episodes-{k:010d}.json" for k in range(RECEIPTS)]
    begun_s = time.monotonic()
    for name in names:
        storage.put(name, text, durable=False)
    put_s = time.monotonic() - begun_s
    get_s = spent_s(lambda: [(storage.exists(name), storage.get(name)) for name in names])
    list_s = spent_s(lambda: storage.names("many"))
    yield {
        "figure": "receipts",
        "bytes": len(text),
        "put_us": 1e6 * put_s / RECEIPTS,
        "get_us": 1e6 * get_s / RECEIPTS,
        "list_us": 1e6 * list_s / RECEIPTS,
    }


def queried(run: Path) -> Iterator[dict[str, Any]]:
    """Per-agent returns over all rows, by DuckDB, where it is installed."""
    try:
        import duckdb
    except ImportError:
        return
    rows = gk.load(run).agent_steps.num_rows
    text = f"SELECT agent, sum(reward) FROM '{run / 'agent_steps.parquet'}' GROUP BY agent"
    duckdb.sql(text).fetchall()
    seconds = min(spent_s(lambda: duckdb.sql(text).fetchall()) for _ in range(5))
    yield {"figure": "query", "rows": rows, "rows_per_s": rows / seconds}


def episodes() -> Iterator[dict[str, Any]]:
    """What a merge does with the rows of episodes: all of them are in memory then."""
    with tempfile.TemporaryDirectory(prefix="scale-") as folder:
        evidence = gk.rollout("two_robot_line", episodes=50, out=Path(folder, "run"))
        table, manifest = evidence.episode_table.cast(EPISODES), evidence.manifest
        a_file = Path(folder, "run", "episodes.parquet").stat().st_size / table.num_rows
    many = pa.concat_tables([table] * (EPISODES_MADE // table.num_rows))
    numbers = pa.array(range(many.num_rows), EPISODES.field("episode").type)
    many = many.set_column(0, EPISODES.field("episode"), numbers)
    before = peak_bytes()
    merge_s = spent_s(lambda: merged_episodes(many.to_batches()))
    print_s = spent_s(lambda: fingerprints(manifest, many))
    grown = peak_bytes() - before
    yield {
        "figure": "episodes",
        "merge_us": 1e6 * merge_s / many.num_rows,
        "fingerprint_us": 1e6 * print_s / many.num_rows,
        "bytes": a_file,
        "memory_bytes": (many.nbytes + grown) / many.num_rows,
    }


def peak_bytes() -> int:
    """The most memory that this process ever had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def executors() -> Iterator[dict[str, Any]]:
    """Null tasks by two processes of this machine; Ray's are in ray_cluster.py."""
    tasks = (WorkTask(f"null-{k}", "builtins:bool") for k in range(NULLS))  # bool(report)
    begun_s, begun_cpu_s = time.monotonic(), cpu_s()
    done = sum(each.outcome.status == "done" for each in LocalExecutor(2).map(tasks))
    yield {
        "figure": "executor",
        "name": "local, 2 workers",
        "tasks": done,
        "tasks_per_s": done / (time.monotonic() - begun_s),
        "driver_cpu_us": 1e6 * (cpu_s() - begun_cpu_s) / done,
    }


def paper(seen: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """10^10 agent-steps on 100 nodes of 32 cores at 10 Gbit/s: arithmetic from what was measured.

    Cores are taken to be as fast as this one, and to be kept busy.
    """
    merge_us = one(seen, "merge")["cpu_us"] if has(seen, "merge") else None
    for each in seen:
        if each["figure"] not in ("level", "kernel"):
            continue
        size = each["bytes"] * WANTED
        found = {
            "figure": "paper",
            "task": each["task"],
            "level": each["level"],
            "engine": "kernel" if each["figure"] == "kernel" else "python",
            "hours_of_all_cores": each["cpu_us"] * 1e-6 * WANTED / (NODES * CORES) / 3600,
            "tb": size / 1e12,
            "upload_s_of_all_links": size / (NODES * LINK_BYTES_PER_S),
        }
        if merge_us is not None and size and each["task"] == "spread":  # merged here
            found["merge_hours_of_one_core"] = merge_us * 1e-6 * WANTED / 3600
            found["read_hours_of_one_link"] = size / LINK_BYTES_PER_S / 3600
        yield found
    if all(has(seen, figure) for figure in ("level", "merge", "episodes", "executor")):
        yield from crowd(seen)


def crowd(seen: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Episodes, parts and requests, where an episode has as many steps as one of spread."""
    steps = next(e["steps_an_episode"] for e in seen if e.get("task") == "spread")
    number = WANTED / steps
    parts = number / 256
    rows, receipts = one(seen, "episodes"), one(seen, "receipts")
    yield {
        "figure": "paper, one run",
        "episodes": number,
        "parts": parts,
        "episodes_in_memory_gib": number * rows["memory_bytes"] / GIB,
        "fingerprint_hours": number * (rows["merge_us"] + rows["fingerprint_us"]) / 3.6e9,
        "receipts_gb": parts * receipts["bytes"] / 1e9,
        "receipts_read_hours_one_by_one": 2 * parts * STORE_ROUND_TRIP_S / 3600,
        "merge_hours_for_parts": parts * one(seen, "part")["merge_ms"] / 3.6e6,
        "driver_minutes": parts * one(seen, "executor")["driver_cpu_us"] / 6e7,
    }


def has(seen: list[dict[str, Any]], figure: str) -> bool:
    """Whether a figure was measured."""
    return any(each["figure"] == figure for each in seen)


def one(seen: list[dict[str, Any]], figure: str) -> dict[str, Any]:
    """The line of a figure that has one."""
    return next(each for each in seen if each["figure"] == figure)


def main() -> int:
    """Prints each figure as it is measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--agent-steps", type=int, default=24_000)
    parser.add_argument("--only", default="level,kernel,store,merge,episodes,executor")
    given = parser.parse_args()
    steps = given.agent_steps
    figures: dict[str, Callable[[], Iterator[dict[str, Any]]]] = {
        "level": lambda: levels(steps),
        "kernel": lambda: kernels(steps),
        "store": lambda: stores(steps),
        "merge": lambda: merges(steps),
        "episodes": episodes,
        "executor": executors,
    }
    seen: list[dict[str, Any]] = []
    for name in given.only.split(","):
        for figure in figures[name]():
            seen.append(figure)
            tell(figure)
    for figure in paper(seen):
        tell(figure)
    return 0


def tell(figure: dict[str, Any]) -> None:
    """One line, to three digits."""
    short = {k: float(f"{v:.3g}") if isinstance(v, float) else v for k, v in figure.items()}
    print(json.dumps(short), flush=True)


if __name__ == "__main__":
    sys.exit(main())
