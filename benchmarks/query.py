"""Per-agent returns over many runs, by `gamekeeper query`, as a user waits for them.

Four environments are recorded, a few thousand rows each, and their runs copied: the rows of a
copy are the same, their number, files and manifests are not. So disk and parsing are as in 1,000
different runs; compression is that of few episodes, and the copies lie in the page cache.

Prints JSON lines: the size; a whole process that does nothing (Python and the command line), that
asks one run, that asks all (wall and CPU seconds, medians); and the parts of the last within one
process.

    python benchmarks/query.py [--runs 1000] [--rows 10000] [--repeats 5]
"""

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gamekeeper as gk

ENVIRONMENTS = ("two_robot_line", "handover", "warehouse", "spread")
SQL = "select agent, count(*) as episodes, avg(return) as mean from returns group by agent"


def recorded(folder: Path, rows: int) -> list[Path]:
    """A run of each environment with about that many rows."""
    found = []
    for name in ENVIRONMENTS:
        few = gk.rollout(name, episodes=20)
        episodes = max(round(20 * rows / few.agent_steps.num_rows), 1)
        gk.rollout(name, episodes=episodes, out=folder / name)
        found.append(folder / name)
    return found


def command(*words: str) -> tuple[float, float]:
    """Wall and CPU seconds of a whole process."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    line = [sys.executable, "-m", "gamekeeper", *words]
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL)
    wall_s, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def told(what: str, repeats: int, *words: str) -> None:
    """Prints the medians of a command."""
    times = [command(*words) for _ in range(repeats)]
    wall_s, cpu_s = (statistics.median(each) for each in zip(*times, strict=True))
    print(
        json.dumps(
            {
                "what": what,
                "wall_s": round(wall_s, 3),
                "cpu_s": round(cpu_s, 3),
                "least_wall_s": round(min(each[0] for each in times), 3),
                "repeats": repeats,
            }
        ),
        flush=True,
    )


def parts(runs: Path) -> dict[str, float]:
    """Seconds of wall time within one process, part by part."""
    found: dict[str, float] = {}

    def timed(name: str, work: Callable[[], Any]) -> Any:
        begun = time.perf_counter()
        result = work()
        found[name] = round(time.perf_counter() - begun, 3)
        return result

    from gamekeeper.viewing.sql import Session
    from gamekeeper.viewing.sql.evidence_places import places_of

    timed("import_duckdb", lambda: __import__("duckdb"))
    places = timed("manifests", lambda: places_of([runs]))
    with timed("open", lambda: Session(places)) as session:
        asked = timed("views_and_binding", lambda: session.ask(SQL))
        timed("rows", lambda: list(asked))
    return found


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--rows", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="gamekeeper-query-"))
    try:
        sources = recorded(folder, options.rows)
        runs = folder / "runs"
        for number in range(options.runs):
            shutil.copytree(sources[number % len(sources)], runs / f"run-{number:05d}")
        rows = sum(gk.load(source).agent_steps.num_rows for source in sources)
        size = sum(path.stat().st_size for path in runs.rglob("*") if path.is_file())
        print(
            json.dumps(
                {
                    "runs": options.runs,
                    "size_bytes": size,
                    "rows": rows * options.runs // len(sources),
                    "environments": list(ENVIRONMENTS),
                    "cores": os.cpu_count(),
                }
            ),
            flush=True,
        )
        told("nothing: --version", options.repeats, "--version")
        told("one run", options.repeats, "query", str(sources[0]), SQL)
        told("all runs", options.repeats, "query", str(runs), SQL)
        print(json.dumps({"what": "parts of one process", **parts(runs)}), flush=True)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
